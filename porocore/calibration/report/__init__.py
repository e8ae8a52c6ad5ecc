"""Report page of a calibration: fit over data, intervals, profiles, plane, what the data do not see."""
