"""Laws of the macroscale: closures and their list, laws of them, direct FE², adaptive surrogates.

A closure is written once, here, in numpy, and serves every macro backend. With a cell law (a surrogate, the
cell solver itself, the linear limit: whatever predicts the responses of a batch of states) it makes a
:class:`~porocore.interfaces.law.MacroLaw`.
"""
