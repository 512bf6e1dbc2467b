"""SchemaError: the one error that decoding, key parsing and message construction raise."""


class SchemaError(ValueError):
    """A payload, key or field that is not what the contract says; the message names the cause."""
