from validation.harness import holds

test_accelerations_move_with_the_scene = holds("invariance")
