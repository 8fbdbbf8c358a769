from validation.harness import holds

test_a_consistent_velocity_keeps_the_joints_of_a_chain_together = holds("chain-coupling")
