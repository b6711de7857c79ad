"""One module a peer: translate a problem, solve it, hand back its polynomials."""
