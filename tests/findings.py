"""What a verification found, by the codes of its checks."""


def check_of(verification, code):
    """The first check of that code."""
    return next(check for check in verification.checks if check.code == code)


def failed(verification):
    """Codes of all checks that failed."""
    return {check.code for check in verification.checks if check.verdict == "fail"}
