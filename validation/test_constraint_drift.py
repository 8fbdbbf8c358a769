from validation.harness import holds

test_the_constraint_drift_is_the_rate_of_the_constraints = holds("constraint-drift")
