from validation.harness import holds

test_the_remainder_of_a_chain_is_the_rate_of_its_coupling = holds("chain-remainder")
