"""The local fields of one state of the cell: as files for ParaView and as pictures."""
