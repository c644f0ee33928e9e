//! Speed over ground from the sentences of a satellite receiver.

use autoswing::decimal::parse_decimal;

use super::sentence::{Sentence, checksum};

/// Metres per second in a knot.
const M_S_PER_KNOT: f32 = 0.514_444;

/// Highest plausible speed, m/s.
const MAX_SPEED_M_S: f32 = 150.0;

/// Receiver of `RMC` and `VTG`, by any talker.
#[derive(Debug, Default)]
pub struct SpeedReceiver {
    /// Characters since the last `$`; a longer sentence than allowed is cut, and its checksum then wrong.
    received: Sentence,
}

impl SpeedReceiver {
    /// Processes a byte; returns the speed, m/s, of the sentence that it completes.
    pub fn push_byte(&mut self, byte: u8) -> Option<f32> {
        match byte {
            b'$' => self.received.clear(),
            b'\r' | b'\n' => {
                let speed = parse_speed(&self.received);
                self.received.clear();
                return speed;
            }
            // Infallible unless it is full.
            _ => drop(self.received.push(byte)),
        }
        None
    }
}

/// Speed of a sentence between `$` and the line end, m/s; `None` for others, and without a valid position.
fn parse_speed(sentence: &[u8]) -> Option<f32> {
    let (body, sum) = str::from_utf8(sentence).ok()?.split_once('*')?;
    if u8::from_str_radix(sum, 16) != Ok(checksum(body.as_bytes())) {
        return None;
    }
    let field = |index: usize| body.split(',').nth(index);
    let knots = match field(0)?.get(2..)? {
        "RMC" if field(2)? == "A" => field(7)?,
        "VTG" => field(5)?,
        _ => return None,
    };
    let speed_m_s = M_S_PER_KNOT * parse_decimal(knots)?;
    (0.0..=MAX_SPEED_M_S).contains(&speed_m_s).then_some(speed_m_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn received_speeds(bytes: &[u8]) -> Vec<f32> {
        let mut receiver = SpeedReceiver::default();
        bytes.iter().filter_map(|&byte| receiver.push_byte(byte)).collect()
    }

    /// The examples of the NMEA 0183 data sheet of SiRF; the last digit changed; a void position; no speed; too fast.
    #[test]
    fn the_speed_of_valid_sentences_is_received() {
        for (sentence, knots) in [
            ("$GPRMC,161229.487,A,3723.2475,N,12158.3416,W,0.13,309.62,120598,,*10", Some(0.13)),
            ("$GPVTG,309.62,T,,M,0.13,N,0.2,K*6E", Some(0.13)),
            ("$GPVTG,309.62,T,,M,0.14,N,0.2,K*6E", None),
            ("$GPRMC,161229.487,V,,,,,,,120598,,*31", None),
            ("$GNRMC,,A,,,,,,,,,*47", None),
            ("$GPVTG,309.62,T,,M,999.0,N,0.2,K*67", None),
            ("$HCHDM,101.1,M*28", None),
        ] {
            let bytes = format!("noise{sentence}\r\n");
            let expected: Vec<f32> = knots.map(|knots: f32| knots * 0.514_444).into_iter().collect();
            assert_eq!(received_speeds(bytes.as_bytes()), expected, "{sentence}");
        }
        assert!(received_speeds(&[b"$".as_slice(), &[b'9'; 500], b"*00\r\n"].concat()).is_empty());
    }
}
