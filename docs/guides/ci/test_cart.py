import cart

from eomcheck.testing import EquationsOfMotion, parametrize_with_claims

CART = EquationsOfMotion(
    3,
    M=cart.M,
    bias=cart.bias,
    gravity=cart.gravity,
    qdd=cart.qdd,
    T=cart.T,
    U=cart.U,
    R=cart.R,
    name="cart",
)


@parametrize_with_claims(CART)
def test_cart(check):
    check()
