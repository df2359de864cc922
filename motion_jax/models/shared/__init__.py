"""What several methods share: blocks and streams, edits, autoencoders, captions, masks, lengths."""
