from validation.harness import holds

test_the_constraint_jacobian_times_the_velocity_is_the_constraint = holds("constraint-velocity")
