"""Closed forms of macroscopic problems: Terzaghi, Mandel, Armstrong, Xie & Leo."""
