import cart

from eomcheck.testing import Functions, parametrize_with_claims

CART = Functions(
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
