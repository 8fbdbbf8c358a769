from validation.harness import holds

test_kane_and_modified_lagrange_have_the_same_mass_matrix = holds("kane-ml-mass")
