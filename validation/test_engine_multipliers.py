from validation.harness import holds

test_every_formulation_with_multipliers_gives_those_of_every_engine = holds("engine-multipliers")
