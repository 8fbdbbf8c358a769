from validation.harness import holds

test_the_mass_matrix_is_that_of_every_engine = holds("mass-matrix")
