from validation.harness import holds

test_the_generalized_forces_are_the_derivative_of_the_potential_energy = holds("generalized-forces")
