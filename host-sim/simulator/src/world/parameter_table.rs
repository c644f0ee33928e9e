//! Parameters of a simulated autopilot, as ArduPilot and PX4 answer for them, with the faults of real links.

use mavlink_dialect::{CharArray, MavMessage, MavParamType, PARAM_VALUE_DATA};

const FLOAT: MavParamType = MavParamType::MAV_PARAM_TYPE_REAL32;
const BYTE: MavParamType = MavParamType::MAV_PARAM_TYPE_INT8;
const SHORT: MavParamType = MavParamType::MAV_PARAM_TYPE_INT16;
const LONG: MavParamType = MavParamType::MAV_PARAM_TYPE_INT32;

/// Parameter of an autopilot.
#[derive(Clone, Debug)]
struct Parameter {
    name: String,
    kind: MavParamType,
    number: f64,
    is_read_only: bool,
}

/// Faults of the link and of its other users.
#[derive(Clone, Debug, Default)]
pub struct ParameterFaults {
    /// Replies of which one is lost; 0 loses none.
    pub lost_reply_period: u32,
    /// Parameter that a ground station writes after each write of it, and the number.
    pub rival_write: Option<(&'static str, f64)>,
}

/// Parameters of an autopilot.
#[derive(Clone, Debug)]
pub struct ParameterTable {
    parameters: Vec<Parameter>,
    /// Whether integers are sent as their bytes (PX4), and not as floats (ArduPilot).
    is_bytewise: bool,
    /// Faults of the link.
    pub faults: ParameterFaults,
    reply_count: u32,
}

impl ParameterTable {
    /// The parameters of ArduPilot 4.7 that concern attitude and compasses, at the defaults of an aeroplane without a
    /// compass.
    #[must_use]
    pub fn ardupilot() -> Self {
        let mut table = Self::empty(false);
        for (name, kind, number) in [
            ("AHRS_TRIM_X", FLOAT, 0.0),
            ("AHRS_TRIM_Y", FLOAT, 0.0),
            ("PTCH_TRIM_DEG", FLOAT, 0.0),
            ("FLIGHT_OPTIONS", LONG, 0.0),
            ("Q_ENABLE", BYTE, 0.0),
            ("SCHED_LOOP_RATE", SHORT, 50.0),
            ("COMPASS_ENABLE", BYTE, 1.0),
            ("COMPASS_LEARN", BYTE, 0.0),
            ("COMPASS_PRIO1_ID", LONG, 0.0),
            ("COMPASS_PRIO2_ID", LONG, 0.0),
            ("COMPASS_PRIO3_ID", LONG, 0.0),
            ("EK3_SRC1_YAW", BYTE, 1.0),
            ("VISO_TYPE", BYTE, 0.0),
            ("VISO_YAW_M_NSE", FLOAT, 0.2),
        ] {
            table.add_parameter(name, kind, number);
        }
        for slot in ["", "2", "3"] {
            for (name, kind, number) in
                [("DEV_ID", LONG, 0.0), ("USE", BYTE, 1.0), ("ORIENT", BYTE, 0.0), ("SCALE", FLOAT, 0.0)]
            {
                table.add_parameter(&format!("COMPASS_{name}{slot}"), kind, number);
            }
            for vector in ["OFS", "DIA", "ODI", "MOT"] {
                for axis in ["X", "Y", "Z"] {
                    table.add_parameter(&format!("COMPASS_{vector}{slot}_{axis}"), FLOAT, 0.0);
                }
            }
        }
        table
    }

    /// The parameters of PX4 1.17 that concern a compass and a yaw from outside.
    #[must_use]
    pub fn px4() -> Self {
        let mut table = Self::empty(true);
        for (name, kind, number) in
            [("EKF2_EV_CTRL", LONG, 15.0), ("EKF2_MAG_TYPE", LONG, 0.0), ("EKF2_EVA_NOISE", FLOAT, 0.1)]
        {
            table.add_parameter(name, kind, number);
        }
        for slot in 0..4 {
            for (name, number) in [("ID", 0.0), ("PRIO", -1.0), ("ROT", -1.0)] {
                table.add_parameter(&format!("CAL_MAG{slot}_{name}"), LONG, number);
            }
            for (vector, number) in [("OFF", 0.0), ("SCALE", 1.0), ("ODIAG", 0.0), ("COMP", 0.0)] {
                for axis in ["X", "Y", "Z"] {
                    table.add_parameter(&format!("CAL_MAG{slot}_{axis}{vector}"), FLOAT, number);
                }
            }
        }
        table
    }

    /// No parameters.
    #[must_use]
    pub const fn empty(is_bytewise: bool) -> Self {
        let faults = ParameterFaults { lost_reply_period: 0, rival_write: None };
        Self { parameters: Vec::new(), is_bytewise, faults, reply_count: 0 }
    }

    /// Number of a parameter.
    #[must_use]
    pub fn number(&self, name: &str) -> Option<f64> {
        self.parameters.iter().find(|parameter| parameter.name == name).map(|parameter| parameter.number)
    }

    /// Sets a parameter and returns the message with which the autopilot reports the change.
    ///
    /// # Panics
    ///
    /// If there is no such parameter.
    pub fn set_number(&mut self, name: &str, number: f64) -> PARAM_VALUE_DATA {
        let index = self.parameters.iter().position(|parameter| parameter.name == name);
        let index = index.unwrap_or_else(|| panic!("no parameter {name}"));
        self.parameters[index].number = number;
        self.reply(index)
    }

    /// Makes a parameter ignore writes.
    pub fn set_read_only(&mut self, name: &str) {
        self.parameters.iter_mut().filter(|known| known.name == name).for_each(|known| known.is_read_only = true);
    }

    /// Removes a parameter, as another version of the firmware does not have it.
    pub fn remove_parameter(&mut self, name: &str) {
        self.parameters.retain(|parameter| parameter.name != name);
    }

    /// Replies to a message; none to other messages, and to a name or a kind that the autopilot does not have.
    pub(super) fn replies(&mut self, message: &MavMessage) -> Vec<PARAM_VALUE_DATA> {
        let replies = match message {
            MavMessage::PARAM_REQUEST_READ(request) => {
                self.index_of(&request.param_id).map(|index| self.reply(index)).into_iter().collect()
            }
            MavMessage::PARAM_SET(change) => self
                .index_of(&change.param_id)
                .map_or_else(Vec::new, |index| self.write_parameter(index, change.param_value, change.param_type)),
            _ => Vec::new(),
        };
        replies.into_iter().filter(|_| !self.is_next_reply_lost()).collect()
    }

    fn write_parameter(&mut self, index: usize, value: f32, kind: MavParamType) -> Vec<PARAM_VALUE_DATA> {
        let parameter = &mut self.parameters[index];
        if self.is_bytewise && kind != parameter.kind {
            return Vec::new();
        }
        let is_integer = parameter.kind != FLOAT;
        let number = match (is_integer, self.is_bytewise) {
            (true, true) => f64::from(value.to_bits().cast_signed()),
            (true, false) => f64::from(value).round(),
            (false, _) => f64::from(value),
        };
        if !parameter.is_read_only {
            parameter.number = number;
        }
        let mut replies = vec![self.reply(index)];
        if let Some((name, rival_number)) = self.faults.rival_write
            && self.parameters[index].name == name
        {
            replies.push(self.set_number(name, rival_number));
        }
        replies
    }

    fn is_next_reply_lost(&mut self) -> bool {
        self.reply_count += 1;
        self.faults.lost_reply_period > 0 && self.reply_count.is_multiple_of(self.faults.lost_reply_period)
    }

    fn index_of(&self, name: &CharArray<16>) -> Option<usize> {
        self.parameters.iter().position(|parameter| name.to_str() == Ok(parameter.name.as_str()))
    }

    fn reply(&self, index: usize) -> PARAM_VALUE_DATA {
        let Parameter { name, kind, number, .. } = &self.parameters[index];
        let is_bytes = self.is_bytewise && *kind != FLOAT;
        PARAM_VALUE_DATA {
            param_value: if is_bytes { f32::from_bits((*number as i32).cast_unsigned()) } else { *number as f32 },
            param_count: self.parameters.len() as u16,
            param_index: index as u16,
            param_id: name.as_str().into(),
            param_type: *kind,
        }
    }

    fn add_parameter(&mut self, name: &str, kind: MavParamType, number: f64) {
        self.parameters.push(Parameter { name: name.to_owned(), kind, number, is_read_only: false });
    }
}
