from validation.harness import holds

test_every_term_is_a_finite_number = holds("finite-terms")
