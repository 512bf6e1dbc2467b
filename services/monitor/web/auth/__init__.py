"""Authentication and authorization: users, roles, sessions and tokens."""
