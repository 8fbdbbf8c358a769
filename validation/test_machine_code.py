from validation.harness import holds

test_machine_code_gives_the_acceleration_of_the_public_path = holds("machine-code")
