//! Attitude datagrams of an external simulator.

use std::fmt;

use simulator::world::rotation::Euler;

/// Reason why a datagram was rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DatagramError {
    /// Not text with three or four numbers.
    Malformed,
    /// An angle or the step is out of range.
    OutOfRange,
}

impl DatagramError {
    /// Stable error code for scripts.
    #[must_use]
    pub const fn stable_code(self) -> &'static str {
        match self {
            Self::Malformed => "bad-datagram",
            Self::OutOfRange => "datagram-out-of-range",
        }
    }
}

impl fmt::Display for DatagramError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Malformed => "expected text of three or four numbers: roll_deg pitch_deg yaw_deg step_s",
            Self::OutOfRange => "roll is -180 to 180, pitch -90 to 90, yaw -360 to 360 deg, step_s 0 to 1",
        })
    }
}

impl std::error::Error for DatagramError {}

/// Attitude of the aircraft from an external simulator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeDatagram {
    /// Attitude; yaw from magnetic north.
    pub attitude: Euler,
    /// Time until the simulator's next datagram, microseconds, if it drives the module's clock.
    pub step_us: Option<u64>,
}

/// Parses a datagram `roll_deg pitch_deg yaw_deg [step_s]`: right wing down and nose up positive, yaw from magnetic north.
///
/// # Errors
///
/// [`DatagramError`] for any other content.
pub fn parse_attitude(datagram: &[u8]) -> Result<AttitudeDatagram, DatagramError> {
    let text = str::from_utf8(datagram).map_err(|_| DatagramError::Malformed)?;
    let mut numbers = text.split_ascii_whitespace().map(str::parse::<f64>);
    let (Some(Ok(roll_deg)), Some(Ok(pitch_deg)), Some(Ok(yaw_deg)), Ok(step_s), None) =
        (numbers.next(), numbers.next(), numbers.next(), numbers.next().transpose(), numbers.next())
    else {
        return Err(DatagramError::Malformed);
    };
    // NaN is outside every range.
    let is_angle = |deg: f64, max_deg: f64| (-max_deg..=max_deg).contains(&deg);
    let is_step = step_s.is_none_or(|step_s| (0.0..=1.0).contains(&step_s));
    if is_angle(roll_deg, 180.0) && is_angle(pitch_deg, 90.0) && is_angle(yaw_deg, 360.0) && is_step {
        let attitude = Euler::from_deg(roll_deg, pitch_deg, yaw_deg);
        Ok(AttitudeDatagram { attitude, step_us: step_s.map(|step_s| (step_s * 1e6).round() as u64) })
    } else {
        Err(DatagramError::OutOfRange)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_numbers_are_an_attitude_and_a_fourth_its_step() {
        let attitude = Euler::from_deg(10.0, -5.0, 270.0);
        for (text, step_us) in [
            ("10 -5 270", None),
            ("  1e1\t-5.0  270\n", None),
            ("10 -5 270\r\n", None),
            ("10 -5 270 0.02", Some(20_000)),
        ] {
            assert_eq!(parse_attitude(text.as_bytes()), Ok(AttitudeDatagram { attitude, step_us }), "{text:?}");
        }
        assert!(parse_attitude(b"-180 -90 -360").is_ok() && parse_attitude(b"180 90 360").is_ok());
    }

    #[test]
    fn other_datagrams_are_malformed_or_out_of_range() {
        let malformed: [&[u8]; 7] = [b"", b"1 2", b"1 2 3 4 5", b"1,2,3", b"1 2 north", b"\xff\xfe\x00", &[b'9'; 2000]];
        for datagram in malformed {
            assert_eq!(parse_attitude(datagram), Err(DatagramError::Malformed), "{datagram:?}");
        }
        for text in
            ["181 0 0", "0 90.1 0", "0 0 361", "nan 0 0", "0 inf 0", "0 0 -inf", "1e999 0 0", "0 0 0 1.1", "0 0 0 -1"]
        {
            assert_eq!(parse_attitude(text.as_bytes()), Err(DatagramError::OutOfRange), "{text}");
        }
    }
}
