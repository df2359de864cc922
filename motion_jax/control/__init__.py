"""What a motion is asked to do beside its words: paths, poses, places of hands and feet, loops, parts of the body."""
