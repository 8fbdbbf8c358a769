import trolley

from eomcheck.testing import EquationsOfMotion, parametrize_with_claims

NAMES = ("M", "bias", "gravity", "qdd", "T", "U")
TROLLEY = EquationsOfMotion(2, **{name: getattr(trolley, name) for name in NAMES}, name="trolley")


@parametrize_with_claims(TROLLEY)
def test_trolley(check):
    check()
