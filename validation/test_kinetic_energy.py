from validation.harness import holds

test_the_mass_matrix_gives_the_kinetic_energy = holds("kinetic-energy")
