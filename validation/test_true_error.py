import math

from eomcheck import strategies
from validation.harness import holds

test_the_error_against_the_enclosed_truth_is_what_rounding_explains = holds("true-error")

test_the_error_is_what_rounding_explains_with_wheels_at_any_angle = holds(
    "true-error",
    lambda scene: strategies.states(scene, angle=math.pi),
    wheel_angle=1.55,
)
