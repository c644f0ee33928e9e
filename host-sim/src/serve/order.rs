//! What a person tells the pilot, a line each: words, numbers in degrees and seconds.

use std::fmt;
use std::str::{FromStr, SplitWhitespace};

use super::Pattern;

/// An order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Order {
    /// Turn at a bank through an angle, to the right if both have the same sign.
    Turn {
        /// Degrees.
        bank_deg: f64,
        /// Degrees.
        change_deg: f64,
    },
    /// Go straight on at the heading there is, or stay on the spot.
    Level {
        /// For so long.
        seconds: f64,
    },
    /// Turn to a magnetic heading, and hold it.
    Heading {
        /// Degrees.
        deg: f64,
        /// For so long, the turn included.
        seconds: f64,
    },
    /// Fly a pattern from now on.
    Pattern(Pattern),
    /// Level out, stand on the ground, disarm.
    Land,
    /// Arm, fly on.
    TakeOff,
    /// Tell the truth.
    Status,
    /// Tell the orders there are.
    Help,
}

/// The words of all orders with what each does.
pub const WORDS: [(&str, &str); 8] = [
    ("turn BANK DEG", "turn at a bank (1 to 60) through an angle (to 3600); DEG -360 is a full circle to the left"),
    ("level S", "go straight on, or stay on the spot, for so many seconds (to 3600)"),
    ("heading DEG S", "turn to a magnetic heading and hold it, for so many seconds in all"),
    ("pattern NAME", "fly routine, circles, wandering or level from now on"),
    ("land", "level out and stand on the ground, disarmed: `reboot` and `set mount` need that"),
    ("takeoff", "arm and fly on"),
    ("status", "the true attitude and heading; the module does not know them"),
    ("help", "this list"),
];

/// Why a line is no order, or none for now.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum OrderError {
    /// There is no such word.
    Unknown(String),
    /// A word or number is missing after this one.
    Missing(&'static str),
    /// There is a word too many.
    Unexpected(String),
    /// Not what is expected there.
    BadValue(&'static str),
    /// A number that nothing flies.
    OutOfRange(&'static str),
    /// Somebody else's simulator flies.
    Visited,
    /// It stands on the ground.
    Landed,
}

impl OrderError {
    /// A stable code for scripts.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Self::Unknown(_) => "unknown-order",
            Self::Missing(_) => "missing-argument",
            Self::Unexpected(_) => "unexpected-argument",
            Self::BadValue(_) => "bad-value",
            Self::OutOfRange(_) => "out-of-range",
            Self::Visited => "flown-by-another",
            Self::Landed => "landed",
        }
    }
}

impl fmt::Display for OrderError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown(word) => {
                let orders = WORDS.map(|(order, _)| order).join(", ");
                write!(f, "{} is no order; there are {orders}", shown(word))
            }
            Self::Missing(what) => write!(f, "{what} is missing"),
            Self::Unexpected(word) => write!(f, "{} is too much", shown(word)),
            Self::BadValue(expected) => write!(f, "expected {expected}"),
            Self::OutOfRange(range) => f.write_str(range),
            Self::Visited => f.write_str("another simulator says how the aircraft lies; there are status and help"),
            Self::Landed => f.write_str("it stands on the ground; takeoff"),
        }
    }
}

impl std::error::Error for OrderError {}

/// What was typed, without what a terminal would obey, and not all of it if it is long.
fn shown(word: &str) -> String {
    word.chars().take(40).flat_map(char::escape_default).collect()
}

/// The list of orders.
pub(super) fn help() -> String {
    WORDS.iter().fold("ok orders:".to_owned(), |text, (order, does)| format!("{text}\n  {order:15}{does}"))
}

impl FromStr for Order {
    type Err = OrderError;

    fn from_str(line: &str) -> Result<Self, OrderError> {
        let mut words = line.split_whitespace();
        let word = words.next().unwrap_or_default();
        let order = match word.to_ascii_lowercase().as_str() {
            "turn" => Self::Turn { bank_deg: bank(&mut words)?, change_deg: change(&mut words)? },
            "level" => Self::Level { seconds: seconds(&mut words)? },
            "heading" => {
                let deg = number(&mut words, "DEG", 0.0..=360.0, "a heading is 0 to 360 deg")?;
                Self::Heading { deg, seconds: seconds(&mut words)? }
            }
            "pattern" => Self::Pattern(pattern(&mut words)?),
            "land" => Self::Land,
            "takeoff" => Self::TakeOff,
            "status" => Self::Status,
            "help" => Self::Help,
            _ => return Err(OrderError::Unknown(word.to_owned())),
        };
        words.next().map_or(Ok(order), |word| Err(OrderError::Unexpected(word.to_owned())))
    }
}

fn bank(words: &mut SplitWhitespace<'_>) -> Result<f64, OrderError> {
    let deg = number(words, "BANK", -60.0..=60.0, BANK_RANGE)?;
    if deg.abs() >= 1.0 { Ok(deg) } else { Err(OrderError::OutOfRange(BANK_RANGE)) }
}

const BANK_RANGE: &str = "a bank is 1 to 60 deg, either way";

fn change(words: &mut SplitWhitespace<'_>) -> Result<f64, OrderError> {
    let deg = number(words, "DEG", -3600.0..=3600.0, CHANGE_RANGE)?;
    if deg.abs() >= 1.0 { Ok(deg) } else { Err(OrderError::OutOfRange(CHANGE_RANGE)) }
}

const CHANGE_RANGE: &str = "a turn goes through 1 to 3600 deg, either way";

fn seconds(words: &mut SplitWhitespace<'_>) -> Result<f64, OrderError> {
    number(words, "S", 0.1..=3600.0, "a time is 0.1 to 3600 s")
}

fn pattern(words: &mut SplitWhitespace<'_>) -> Result<Pattern, OrderError> {
    let name = words.next().ok_or(OrderError::Missing("NAME"))?;
    Pattern::from_name(&name.to_ascii_lowercase()).ok_or(OrderError::BadValue("routine, circles, wandering or level"))
}

fn number(
    words: &mut SplitWhitespace<'_>,
    name: &'static str,
    range: std::ops::RangeInclusive<f64>,
    range_in_words: &'static str,
) -> Result<f64, OrderError> {
    let word = words.next().ok_or(OrderError::Missing(name))?;
    let value: f64 = word.parse().map_err(|_| OrderError::BadValue("a number"))?;
    // What is not a number lies in no range.
    if range.contains(&value) { Ok(value) } else { Err(OrderError::OutOfRange(range_in_words)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_are_words_and_numbers() {
        for (line, order) in [
            ("turn 25 -360", Order::Turn { bank_deg: 25.0, change_deg: -360.0 }),
            ("  TURN  -10.5  90 ", Order::Turn { bank_deg: -10.5, change_deg: 90.0 }),
            ("level 10", Order::Level { seconds: 10.0 }),
            ("heading 270 9.5", Order::Heading { deg: 270.0, seconds: 9.5 }),
            ("pattern Circles", Order::Pattern(Pattern::Circles)),
            ("land", Order::Land),
            ("takeoff", Order::TakeOff),
            ("status", Order::Status),
            ("help", Order::Help),
        ] {
            assert_eq!(line.parse(), Ok(order), "{line}");
        }
    }

    #[test]
    fn what_is_no_order_is_told_with_a_code() {
        for (line, code) in [
            ("", "unknown-order"),
            ("loop 3", "unknown-order"),
            ("turn", "missing-argument"),
            ("turn 25", "missing-argument"),
            ("turn 25 left", "bad-value"),
            ("turn 61 90", "out-of-range"),
            ("turn 0 90", "out-of-range"),
            ("turn 25 0", "out-of-range"),
            ("turn 25 nan", "out-of-range"),
            ("turn 25 90 5", "unexpected-argument"),
            ("level", "missing-argument"),
            ("level -1", "out-of-range"),
            ("level inf", "out-of-range"),
            ("heading 361 5", "out-of-range"),
            ("heading 90", "missing-argument"),
            ("heading 90 0", "out-of-range"),
            ("pattern", "missing-argument"),
            ("pattern eights", "bad-value"),
            ("land now", "unexpected-argument"),
        ] {
            let error = line.parse::<Order>().unwrap_err();
            assert_eq!(error.code(), code, "{line}: {error}");
        }
    }

    /// Escape sequences would change the terminal of who reads the error.
    #[test]
    fn an_unknown_order_is_told_with_the_list_and_without_control_characters() {
        let error = format!("\u{1b}]0;x\u{7}{}", "y".repeat(10_000)).parse::<Order>().unwrap_err().to_string();
        assert!(error.chars().all(|c| !c.is_control()) && error.len() < 300, "{error}");
        assert!(WORDS.iter().all(|(order, _)| error.contains(order)), "{error}");
    }

    #[test]
    fn every_order_of_the_list_is_one() {
        for (order, _) in WORDS {
            let line = order.replace("BANK", "20").replace("DEG", "90").replace("NAME", "level");
            let line = line.replace(" S", " 5");
            assert!(line.parse::<Order>().is_ok(), "{line}");
            assert!(help().contains(order));
        }
    }
}
