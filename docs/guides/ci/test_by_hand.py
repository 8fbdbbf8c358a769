from by_hand import ByHand

from eomcheck.testing import parametrize_with_claims


@parametrize_with_claims(ByHand)
def test_by_hand(check):
    check()
