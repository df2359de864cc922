"""The smallest whole method: one layer from a sentence and a frame's time to that frame's features.

What docs/adding.md tells of a further method, done: these files, a config and one line in the registry, no other file.
It learns little; it is here to be trained, loaded, asked and judged like the two papers.
"""
