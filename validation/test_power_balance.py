from validation.harness import holds

test_no_acceleration_changes_the_energy = holds("power-balance")
