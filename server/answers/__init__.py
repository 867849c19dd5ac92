"""Schemas of what REST answers: the OpenAPI document, its examples and `/docs` come from them."""
