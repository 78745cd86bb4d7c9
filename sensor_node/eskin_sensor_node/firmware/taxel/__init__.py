"""What the control unit knows of each kind of taxel: inputs, quantities, calibration."""
