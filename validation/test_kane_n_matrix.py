from validation.harness import holds

test_the_inertia_remainder_is_n_times_qdot_with_n_in_full = holds("kane-n-matrix")
