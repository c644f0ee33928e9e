//! Motion of a vehicle over one integration step.

/// Integration step, 20 times shorter than the shortest time constant.
pub const STEP_US: u64 = 5_000;
/// Integration step, seconds.
pub const STEP_S: f64 = STEP_US as f64 / 1e6;

/// Standard gravity, m/s^2.
pub const GRAVITY_M_S2: f64 = 9.806_65;

/// North and east components of a vector given along the nose and to the right.
pub fn north_east(heading_rad: f64, [forward, right]: [f64; 2]) -> [f64; 2] {
    let (sin, cos) = libm::sincos(heading_rad);
    [cos * forward - sin * right, sin * forward + cos * right]
}

/// Components along the nose and to the right of a vector given north and east.
pub fn forward_right(heading_rad: f64, [north, east]: [f64; 2]) -> [f64; 2] {
    let (sin, cos) = libm::sincos(heading_rad);
    [cos * north + sin * east, cos * east - sin * north]
}
