"""The sampled inputs: which components of (H, p) move, in which box, and which range was sampled."""
