from validation.harness import holds

test_every_acceleration_satisfies_the_constraints_differentiated = holds("constraint-acceleration")
