from validation.harness import holds

test_the_acceleration_of_a_chain_comes_back = holds("chain-acceleration")
