"""The learned whole-body policy: observation, action, actor."""
