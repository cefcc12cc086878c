"""The doctor's checks of this side (`common.doctor.run` names them)."""
