"""What every macro backend shares: mesh, boundary data, time loop, Newton's iteration, record and checkpoints."""
