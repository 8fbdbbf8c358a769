from validation.harness import holds

test_all_formulations_with_multipliers_give_the_same = holds("multipliers")
