"""The model-based whole-body controller, by body part."""
