from validation.harness import holds

test_the_mass_of_a_chain_is_diagonal = holds("chain-energy")
