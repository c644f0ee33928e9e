//! The common form of a logged flight.

use autoswing::earth::Day;
use serde::Serialize;

use super::Parameters;
use super::correction::Iron;
use super::series::Series;

/// What a log is written in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Format {
    /// ArduPilot's, binary.
    DataFlash,
    /// ArduPilot's, text.
    DataFlashText,
    /// PX4's.
    ULog,
    /// MAVLink frames with the receiver's clock.
    TLog,
    /// A table.
    Csv,
}

impl Format {
    /// What people call it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::DataFlash => "ArduPilot DataFlash",
            Self::DataFlashText => "ArduPilot DataFlash text",
            Self::ULog => "PX4 ULog",
            Self::TLog => "MAVLink tlog",
            Self::Csv => "CSV",
        }
    }

    /// How old a logged field is at its own time stamp where nothing better is known, seconds: ArduPilot's rows are means
    /// of the interval before them (10 Hz, as most), what is sent over MAVLink is older.
    #[must_use]
    pub const fn usual_age_s(self) -> f64 {
        match self {
            Self::DataFlash | Self::DataFlashText => 0.05,
            Self::TLog => 0.09,
            Self::ULog | Self::Csv => 0.0,
        }
    }
}

/// Whose log it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub enum Autopilot {
    /// ArduPilot.
    ArduPilot,
    /// PX4.
    Px4,
    /// Nobody said.
    #[default]
    Unknown,
}

/// A compass of the aircraft.
#[derive(Clone, Debug, Default)]
pub struct Compass {
    /// As the autopilot counts them, from 1.
    pub number: u8,
    /// In body axes, microtesla: the raw field x, y, z, and the field as the autopilot corrected it.
    pub field: Series<6>,
    /// What the autopilot corrected with at the end.
    pub iron: Option<Iron>,
    /// Whether the autopilot's own heading is made with it, if that is known.
    pub is_used: Option<bool>,
}

/// Columns of [`Flight::gps`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gps {
    /// Latitude, degrees.
    pub latitude_deg: f32,
    /// Longitude, degrees.
    pub longitude_deg: f32,
    /// Height above mean sea level, metres.
    pub height_m: f32,
    /// Speed over ground, m/s.
    pub speed_m_s: f32,
    /// Course over ground from true north, degrees.
    pub course_deg: f32,
    /// Heading from two antennas, degrees from true north; not a number where there is none.
    pub yaw_deg: f32,
}

impl Gps {
    /// As they stand in a row.
    #[must_use]
    pub const fn columns(self) -> [f32; 6] {
        let Self { latitude_deg, longitude_deg, height_m, speed_m_s, course_deg, yaw_deg } = self;
        [latitude_deg, longitude_deg, height_m, speed_m_s, course_deg, yaw_deg]
    }

    /// From a row.
    #[must_use]
    pub const fn from_columns(
        [latitude_deg, longitude_deg, height_m, speed_m_s, course_deg, yaw_deg]: [f32; 6],
    ) -> Self {
        Self { latitude_deg, longitude_deg, height_m, speed_m_s, course_deg, yaw_deg }
    }
}

/// What was passed over while reading.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Bytes, or lines of a table, that belong to nothing.
    pub garbage: u64,
    /// Messages whose time is nonsense.
    pub bad_times: u64,
    /// Rows of an instant that was there already.
    pub repeats: u64,
    /// Rows of the field that the autopilot itself called unhealthy.
    pub unhealthy: u64,
    /// Messages of other systems on the same link.
    pub others: u64,
    /// How often the autopilot restarted in the file.
    pub restarts: u32,
}

/// A flight.
#[derive(Clone, Debug)]
pub struct Flight {
    /// What it was written in.
    pub format: Format,
    /// Whose log it is.
    pub autopilot: Autopilot,
    /// What the autopilot calls its firmware.
    pub firmware: Option<String>,
    /// Whether the log says that it flies on rotors, and on nothing else.
    pub is_copter: bool,
    /// The compasses.
    pub compasses: Vec<Compass>,
    /// Roll and pitch as the autopilot has them, and its yaw from true north, radians; yaw is not a number where it has
    /// none.
    pub attitude: Series<3>,
    /// Which message stood in for the autopilot's own attitude, where that is not logged.
    pub attitude_from: Option<&'static str>,
    /// Body rates p, q, r, rad/s.
    pub rates: Series<3>,
    /// What a receiver says; see [`Gps`].
    pub gps: Series<6>,
    /// Current of the battery, amperes.
    pub current: Series<1>,
    /// When it was armed or disarmed; before the first entry it was the other.
    pub armed: Vec<(f64, bool)>,
    /// A simulator's own roll, pitch and yaw from true north, radians. For scoring, nothing else.
    pub truth: Series<3>,
    /// A reference heading that came with the log, radians, from any north.
    pub reference: Series<1>,
    /// When rows may be used, as the log itself says; 0 or 1.
    pub usable: Series<1>,
    /// The autopilot's parameters.
    pub parameters: Parameters,
    /// The day.
    pub day: Option<Day>,
    /// Rows that carry no time, and are taken to be of the instant of the message before.
    pub unstamped: u64,
    /// The vehicles on a link, by the number of their system: the one that is read first, others as they were heard.
    pub systems: Vec<u8>,
    /// Components of that vehicle with an autopilot on a MAVLink link, the one that is judged first.
    pub components: Vec<u8>,
    /// What was passed over.
    pub counts: Counts,
}

impl Flight {
    /// Nothing of a format.
    #[must_use]
    pub fn new(format: Format) -> Self {
        Self {
            format,
            autopilot: Autopilot::default(),
            firmware: None,
            is_copter: false,
            compasses: Vec::new(),
            attitude: Series::new(),
            attitude_from: None,
            rates: Series::new(),
            gps: Series::new(),
            current: Series::new(),
            armed: Vec::new(),
            truth: Series::new(),
            reference: Series::new(),
            usable: Series::new(),
            parameters: Parameters::default(),
            day: None,
            unstamped: 0,
            systems: Vec::new(),
            components: Vec::new(),
            counts: Counts::default(),
        }
    }

    /// From the first row of the field to the last, seconds.
    #[must_use]
    pub fn lasts_s(&self) -> [f64; 2] {
        let each = self.compasses.iter().filter_map(|compass| {
            let rows = compass.field.rows();
            Some([rows.first()?.t_s, rows.last()?.t_s])
        });
        each.reduce(|[from, to], [first, last]| [from.min(first), to.max(last)]).unwrap_or_default()
    }

    /// Whether it was armed at an instant; none where nothing is known of it.
    #[must_use]
    pub fn is_armed(&self, t_s: f64) -> Option<bool> {
        let &(_, first) = self.armed.first()?;
        let said = self.armed.iter().take_while(|&&(at_s, _)| at_s <= t_s).last();
        Some(said.map_or(!first, |&(_, is)| is))
    }
}
