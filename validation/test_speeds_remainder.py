from validation.harness import holds

test_the_remainder_satisfies_the_constraints_differentiated = holds("speeds-remainder")
