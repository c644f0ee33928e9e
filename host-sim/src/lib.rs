//! Autoswing's firmware tasks flown by a simulated aircraft, in virtual time.
