from validation.harness import holds

test_kane_and_modified_lagrange_have_the_same_right_hand_side = holds("kane-ml-force")
