"""The rig, its scenes, and the samples and targets drawn from them."""
