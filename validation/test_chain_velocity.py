from validation.harness import holds

test_the_velocity_of_a_chain_comes_back = holds("chain-velocity")
