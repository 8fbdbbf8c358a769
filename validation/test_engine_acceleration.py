from validation.harness import holds

test_every_formulation_gives_the_acceleration_of_every_engine = holds("engine-acceleration")
