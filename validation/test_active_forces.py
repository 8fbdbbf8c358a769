from validation.harness import holds

test_kane_s_active_forces_are_lagrange_s_projected = holds("active-forces")
