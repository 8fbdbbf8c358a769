from validation.harness import holds

test_the_bias_is_that_of_every_engine = holds("bias")
