"""What a verification found, by the codes of its checks."""


def failed(verification):
    """Codes of all checks that failed."""
    return {check.code for check in verification.checks if check.verdict == "fail"}
