from validation.harness import holds

test_generalized_speeds_give_the_velocity_back = holds("speeds-velocity")
