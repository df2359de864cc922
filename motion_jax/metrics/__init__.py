"""Numbers about motion: scores of embeddings, physics of joints, and the rules that make a row of them."""
