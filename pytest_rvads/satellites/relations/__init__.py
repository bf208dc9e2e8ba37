"""Metamorphic checks: changes of a case that must not change its verdict, or change it in a known way."""
