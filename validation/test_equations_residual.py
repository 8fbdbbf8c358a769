from validation.harness import holds

test_every_acceleration_satisfies_the_equations_of_motion = holds("equations-residual")
