import math

from eomcheck import strategies
from validation.harness import holds

test_all_formulations_give_the_same_acceleration = holds("equivalence")

test_all_formulations_agree_with_wheels_at_any_angle_and_links_in_any_direction = holds(
    "equivalence",
    lambda scene: strategies.states(scene, angle=math.pi),
    wheel_angle=1.55,
)
