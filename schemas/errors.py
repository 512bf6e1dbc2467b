"""SchemaError: the one error that decoding, key parsing and message construction raise."""


class SchemaError(ValueError):
    """A payload, key or field violates the contract; the message names the cause."""
