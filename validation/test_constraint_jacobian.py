from validation.harness import holds

test_the_constraint_jacobian_is_the_derivative_of_the_constraints = holds("constraint-jacobian")
