"""Closed forms of macroscopic problems: Terzaghi, layered soils, swelling, Mandel, Armstrong, Xie & Leo."""
