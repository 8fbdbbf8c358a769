from validation.harness import holds

test_w_of_the_generalized_speeds_spans_the_null_space_of_a = holds("null-space-speeds")
