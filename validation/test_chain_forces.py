from validation.harness import holds

test_the_forces_along_a_chain_do_the_work_of_q = holds("chain-forces")
