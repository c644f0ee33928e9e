//! Messages: their table, and what a row defines.
#![expect(non_camel_case_types, reason = "messages have the names of the protocol's definition")]

use mavlink_core::error::ParserError;
use mavlink_core::types::CharArray;
use mavlink_core::utils::remove_trailing_zeroes;
use mavlink_core::{MavlinkVersion, Message, MessageData};

#[cfg_attr(not(test), expect(clippy::wildcard_imports, reason = "a row may have any of them"))]
use crate::enumerations::*;
use crate::extra_crc::common_extra_crc;
use crate::field::MessageField;

/// Passes the table to the macro `$process`. A row has the name of the message and of its type, its number, and the
/// extra byte of its CRC; its fields in the order on the wire, which is largest first; and after `extension` the fields
/// that only MAVLink 2 has, in the order of the definition. Rows are grouped by the dialect that defines them,
/// and sorted by number.
macro_rules! message_table {
    ($process:ident) => {
        $process! {
            common {
                /// Kind and state of a component, once a second.
                HEARTBEAT: HEARTBEAT_DATA = 0, crc 50 {
                    custom_mode: u32, mavtype: MavType, autopilot: MavAutopilot, base_mode: MavModeFlag,
                    system_status: MavState, mavlink_version: u8
                }
                /// Sensors and battery of the vehicle.
                SYS_STATUS: SYS_STATUS_DATA = 1, crc 124 {
                    onboard_control_sensors_present: MavSysStatusSensor,
                    onboard_control_sensors_enabled: MavSysStatusSensor,
                    onboard_control_sensors_health: MavSysStatusSensor, load: u16, voltage_battery: u16,
                    current_battery: i16, drop_rate_comm: u16, errors_comm: u16, errors_count1: u16,
                    errors_count2: u16, errors_count3: u16, errors_count4: u16, battery_remaining: i8;
                    extension onboard_control_sensors_present_extended: MavSysStatusSensorExtended,
                    onboard_control_sensors_enabled_extended: MavSysStatusSensorExtended,
                    onboard_control_sensors_health_extended: MavSysStatusSensorExtended
                }
                /// Unix time, and time since the start, of the sender.
                SYSTEM_TIME: SYSTEM_TIME_DATA = 2, crc 137 {
                    time_unix_usec: u64, time_boot_ms: u32
                }
                /// Requests a parameter by its name, or by its index.
                PARAM_REQUEST_READ: PARAM_REQUEST_READ_DATA = 20, crc 214 {
                    param_index: i16, target_system: u8, target_component: u8, param_id: CharArray<16>
                }
                /// Requests all parameters.
                PARAM_REQUEST_LIST: PARAM_REQUEST_LIST_DATA = 21, crc 159 {
                    target_system: u8, target_component: u8
                }
                /// A parameter.
                PARAM_VALUE: PARAM_VALUE_DATA = 22, crc 220 {
                    param_value: f32, param_count: u16, param_index: u16, param_id: CharArray<16>,
                    param_type: MavParamType
                }
                /// Changes a parameter.
                PARAM_SET: PARAM_SET_DATA = 23, crc 168 {
                    param_value: f32, target_system: u8, target_component: u8, param_id: CharArray<16>,
                    param_type: MavParamType
                }
                /// Position and velocity as the receiver reports them.
                GPS_RAW_INT: GPS_RAW_INT_DATA = 24, crc 24 {
                    time_usec: u64, lat: i32, lon: i32, alt: i32, eph: u16, epv: u16, vel: u16, cog: u16,
                    fix_type: GpsFixType, satellites_visible: u8;
                    extension alt_ellipsoid: i32, h_acc: u32, v_acc: u32, vel_acc: u32, hdg_acc: u32, yaw: u16
                }
                /// Readings of the first inertial sensor and compass.
                SCALED_IMU: SCALED_IMU_DATA = 26, crc 170 {
                    time_boot_ms: u32, xacc: i16, yacc: i16, zacc: i16, xgyro: i16, ygyro: i16, zgyro: i16, xmag: i16,
                    ymag: i16, zmag: i16;
                    extension temperature: i16
                }
                /// Readings of the first inertial sensor and compass, unscaled in some autopilots.
                RAW_IMU: RAW_IMU_DATA = 27, crc 144 {
                    time_usec: u64, xacc: i16, yacc: i16, zacc: i16, xgyro: i16, ygyro: i16, zgyro: i16, xmag: i16,
                    ymag: i16, zmag: i16;
                    extension id: u8, temperature: i16
                }
                /// Roll, pitch, yaw and body rates.
                ATTITUDE: ATTITUDE_DATA = 30, crc 39 {
                    time_boot_ms: u32, roll: f32, pitch: f32, yaw: f32, rollspeed: f32, pitchspeed: f32,
                    yawspeed: f32
                }
                /// Estimated position and velocity.
                GLOBAL_POSITION_INT: GLOBAL_POSITION_INT_DATA = 33, crc 104 {
                    time_boot_ms: u32, lat: i32, lon: i32, alt: i32, relative_alt: i32, vx: i16, vy: i16, vz: i16,
                    hdg: u16
                }
                /// Pulses of the outputs, microseconds.
                SERVO_OUTPUT_RAW: SERVO_OUTPUT_RAW_DATA = 36, crc 222 {
                    time_usec: u32, servo1_raw: u16, servo2_raw: u16, servo3_raw: u16, servo4_raw: u16, servo5_raw: u16,
                    servo6_raw: u16, servo7_raw: u16, servo8_raw: u16, port: u8;
                    extension servo9_raw: u16, servo10_raw: u16, servo11_raw: u16, servo12_raw: u16, servo13_raw: u16,
                    servo14_raw: u16, servo15_raw: u16, servo16_raw: u16
                }
                /// Requests a group of messages; superseded by `MAV_CMD_SET_MESSAGE_INTERVAL`.
                REQUEST_DATA_STREAM: REQUEST_DATA_STREAM_DATA = 66, crc 148 {
                    req_message_rate: u16, target_system: u8, target_component: u8, req_stream_id: MavDataStream,
                    start_stop: u8
                }
                /// Figures of a head-up display.
                VFR_HUD: VFR_HUD_DATA = 74, crc 20 {
                    airspeed: f32, groundspeed: f32, alt: f32, climb: f32, heading: i16, throttle: u16
                }
                /// A command with a position in integers.
                COMMAND_INT: COMMAND_INT_DATA = 75, crc 158 {
                    param1: f32, param2: f32, param3: f32, param4: f32, x: i32, y: i32, z: f32, command: MavCmd,
                    target_system: u8, target_component: u8, frame: MavFrame, current: u8, autocontinue: u8
                }
                /// A command with seven parameters.
                COMMAND_LONG: COMMAND_LONG_DATA = 76, crc 152 {
                    param1: f32, param2: f32, param3: f32, param4: f32, param5: f32, param6: f32, param7: f32,
                    command: MavCmd, target_system: u8, target_component: u8, confirmation: u8
                }
                /// Result of a command.
                COMMAND_ACK: COMMAND_ACK_DATA = 77, crc 143 {
                    command: MavCmd, result: MavResult;
                    extension progress: u8, result_param2: i32, target_system: u8, target_component: u8
                }
                /// Position and attitude from a source other than the autopilot.
                VISION_POSITION_ESTIMATE: VISION_POSITION_ESTIMATE_DATA = 102, crc 158 {
                    usec: u64, x: f32, y: f32, z: f32, roll: f32, pitch: f32, yaw: f32;
                    extension covariance: [f32; 21], reset_counter: u8
                }
                /// Readings of all inertial sensors, in SI units and gauss.
                HIGHRES_IMU: HIGHRES_IMU_DATA = 105, crc 93 {
                    time_usec: u64, xacc: f32, yacc: f32, zacc: f32, xgyro: f32, ygyro: f32, zgyro: f32, xmag: f32,
                    ymag: f32, zmag: f32, abs_pressure: f32, diff_pressure: f32, pressure_alt: f32, temperature: f32,
                    fields_updated: HighresImuUpdatedFlags;
                    extension id: u8
                }
                /// Readings of the second inertial sensor and compass.
                SCALED_IMU2: SCALED_IMU2_DATA = 116, crc 76 {
                    time_boot_ms: u32, xacc: i16, yacc: i16, zacc: i16, xgyro: i16, ygyro: i16, zgyro: i16, xmag: i16,
                    ymag: i16, zmag: i16;
                    extension temperature: i16
                }
                /// Position and velocity as the second receiver reports them.
                GPS2_RAW: GPS2_RAW_DATA = 124, crc 87 {
                    time_usec: u64, lat: i32, lon: i32, alt: i32, dgps_age: u32, eph: u16, epv: u16, vel: u16, cog: u16,
                    fix_type: GpsFixType, satellites_visible: u8, dgps_numch: u8;
                    extension yaw: u16, alt_ellipsoid: i32, h_acc: u32, v_acc: u32, vel_acc: u32, hdg_acc: u32
                }
                /// Readings of the third inertial sensor and compass.
                SCALED_IMU3: SCALED_IMU3_DATA = 129, crc 46 {
                    time_boot_ms: u32, xacc: i16, yacc: i16, zacc: i16, xgyro: i16, ygyro: i16, zgyro: i16, xmag: i16,
                    ymag: i16, zmag: i16;
                    extension temperature: i16
                }
                /// State of a battery.
                BATTERY_STATUS: BATTERY_STATUS_DATA = 147, crc 154 {
                    current_consumed: i32, energy_consumed: i32, temperature: i16, voltages: [u16; 10],
                    current_battery: i16, id: u8, battery_function: MavBatteryFunction, mavtype: MavBatteryType,
                    battery_remaining: i8;
                    extension time_remaining: i32, charge_state: MavBatteryChargeState, voltages_ext: [u16; 4],
                    mode: MavBatteryMode, fault_bitmask: MavBatteryFault
                }
                /// Result of the calibration of a compass.
                MAG_CAL_REPORT: MAG_CAL_REPORT_DATA = 192, crc 36 {
                    fitness: f32, ofs_x: f32, ofs_y: f32, ofs_z: f32, diag_x: f32, diag_y: f32, diag_z: f32,
                    offdiag_x: f32, offdiag_y: f32, offdiag_z: f32, compass_id: u8, cal_mask: u8,
                    cal_status: MagCalStatus, autosaved: u8;
                    extension orientation_confidence: f32, old_orientation: MavSensorOrientation,
                    new_orientation: MavSensorOrientation, scale_factor: f32
                }
                /// A number with a name.
                NAMED_VALUE_FLOAT: NAMED_VALUE_FLOAT_DATA = 251, crc 170 {
                    time_boot_ms: u32, value: f32, name: CharArray<10>
                }
                /// A text, or a chunk of it.
                STATUSTEXT: STATUSTEXT_DATA = 253, crc 83 {
                    severity: MavSeverity, text: CharArray<50>;
                    extension id: u16, chunk_seq: u8
                }
                /// Speed, voltage and current of four speed controllers, from the number of the first.
                ESC_STATUS: ESC_STATUS_DATA = 291, crc 10 {
                    time_usec: u64, rpm: [i32; 4], voltage: [f32; 4], current: [f32; 4], index: u8
                }
            }
            ardupilotmega {
                /// True state of a simulated vehicle.
                SIMSTATE: SIMSTATE_DATA = 164, crc 154 {
                    roll: f32, pitch: f32, yaw: f32, xacc: f32, yacc: f32, zacc: f32, xgyro: f32, ygyro: f32,
                    zgyro: f32, lat: i32, lng: i32
                }
                /// Progress of the calibration of a compass.
                MAG_CAL_PROGRESS: MAG_CAL_PROGRESS_DATA = 191, crc 92 {
                    direction_x: f32, direction_y: f32, direction_z: f32, compass_id: u8, cal_mask: u8,
                    cal_status: MagCalStatus, attempt: u8, completion_pct: u8, completion_mask: [u8; 10]
                }
                /// Telemetry of the first four speed controllers, voltage and current in hundredths.
                ESC_TELEMETRY_1_TO_4: ESC_TELEMETRY_1_TO_4_DATA = 11030, crc 144 {
                    voltage: [u16; 4], current: [u16; 4], totalcurrent: [u16; 4], rpm: [u16; 4], count: [u16; 4],
                    temperature: [u8; 4]
                }
                /// Telemetry of the next four speed controllers.
                ESC_TELEMETRY_5_TO_8: ESC_TELEMETRY_5_TO_8_DATA = 11031, crc 133 {
                    voltage: [u16; 4], current: [u16; 4], totalcurrent: [u16; 4], rpm: [u16; 4], count: [u16; 4],
                    temperature: [u8; 4]
                }
            }
        }
    };
}

/// Layout of a message's payload.
pub trait PayloadLayout: MessageData {
    /// Length in MAVLink 1, bytes: without the extension fields.
    const V1_LENGTH: usize;
    /// Length in MAVLink 2, bytes, before trailing zeros are truncated.
    const V2_LENGTH: usize = Self::ENCODED_LEN;

    /// The message of a payload that is filled up with zeros to the length in MAVLink 2 or more.
    #[must_use]
    fn from_padded(payload: &[u8]) -> Self;
}

macro_rules! define_messages {
    ($($dialect:ident { $(
        $(#[$doc:meta])*
        $name:ident: $data:ident = $id:literal, crc $crc:literal {
            $($field:ident: $type:ty),* $(; extension $($extension:ident: $extension_type:ty),*)?
        }
    )* })*) => {
        $($(
            $(#[$doc])*
            ///
            #[doc = concat!(
                "Number ", stringify!($id), " of <https://mavlink.io/en/messages/", stringify!($dialect), ".html#",
                stringify!($name), ">."
            )]
            #[derive(Clone, Debug, PartialEq)]
            pub struct $data {
                $(#[doc = concat!("`", stringify!($field), "`.")] pub $field: $type,)*
                $($(#[doc = concat!("`", stringify!($extension), "`; only MAVLink 2 has it.")]
                    pub $extension: $extension_type,)*)?
            }

            impl $data {
                /// All fields are zero.
                pub const DEFAULT: Self = Self {
                    $($field: <$type as MessageField>::ZERO,)*
                    $($($extension: <$extension_type as MessageField>::ZERO,)*)?
                };
            }

            impl Default for $data {
                fn default() -> Self {
                    Self::DEFAULT
                }
            }

            impl PayloadLayout for $data {
                const V1_LENGTH: usize = 0 $(+ <$type as MessageField>::LENGTH)*;

                fn from_padded(payload: &[u8]) -> Self {
                    let rest = payload;
                    $(let ($field, rest) = <$type as MessageField>::read(rest);)*
                    $($(let ($extension, rest) = <$extension_type as MessageField>::read(rest);)*)?
                    debug_assert!(rest.len() + Self::V2_LENGTH == payload.len(), "the length is that of all fields");
                    Self { $($field,)* $($($extension,)*)? }
                }
            }

            impl MessageData for $data {
                type Message = MavMessage;

                const ID: u32 = $id;
                const NAME: &'static str = stringify!($name);
                const EXTRA_CRC: u8 = $crc;
                const ENCODED_LEN: usize = Self::V1_LENGTH $($(+ <$extension_type as MessageField>::LENGTH)*)?;

                fn ser(&self, version: MavlinkVersion, payload: &mut [u8]) -> usize {
                    let payload = &mut payload[..Self::ENCODED_LEN];
                    let rest = &mut *payload;
                    $(let rest = self.$field.write(rest);)*
                    $($(let rest = self.$extension.write(rest);)*)?
                    debug_assert!(rest.is_empty(), "the length is that of all fields");
                    match version {
                        MavlinkVersion::V1 => Self::V1_LENGTH,
                        MavlinkVersion::V2 => remove_trailing_zeroes(payload),
                    }
                }

                /// Never fails: fields that are not sent are zero, and bytes behind the last field are ignored.
                fn deser(version: MavlinkVersion, received: &[u8]) -> Result<Self, ParserError> {
                    let mut payload = [0; Self::ENCODED_LEN];
                    let length = match version {
                        MavlinkVersion::V1 => Self::V1_LENGTH,
                        MavlinkVersion::V2 => Self::V2_LENGTH,
                    };
                    payload[..length].iter_mut().zip(received).for_each(|(byte, received)| *byte = *received);
                    Ok(Self::from_padded(&payload))
                }
            }
        )*)*

        /// A message of the table.
        #[derive(Clone, Debug, PartialEq)]
        pub enum MavMessage {
            $($(#[doc = concat!("`", stringify!($name), "`.")] $name($data),)*)*
        }

        impl MavMessage {
            /// Message with this name, from the numbers of its fields by name and index; zero of a field that is missing.
            /// `None` of a message that the table does not have.
            pub fn from_numbers(name: &str, number_at: &mut dyn FnMut(&str, usize) -> f64) -> Option<Self> {
                match name {
                    $($($data::NAME => Some(Self::$name($data {
                        $($field: MessageField::from_numbers(&mut |index| number_at(stringify!($field), index)),)*
                        $($($extension:
                            MessageField::from_numbers(&mut |index| number_at(stringify!($extension), index)),)*)?
                    })),)*)*
                    _ => None,
                }
            }
        }

        impl Message for MavMessage {
            fn message_id(&self) -> u32 {
                match self {
                    $($(Self::$name(_) => $id,)*)*
                }
            }

            fn message_name(&self) -> &'static str {
                match self {
                    $($(Self::$name(_) => $data::NAME,)*)*
                }
            }

            fn target_system_id(&self) -> Option<u8> {
                match self {
                    $($(Self::$name(message) => field_named!(system message: $($field)* $($($extension)*)?),)*)*
                }
            }

            fn target_component_id(&self) -> Option<u8> {
                match self {
                    $($(Self::$name(message) => field_named!(component message: $($field)* $($($extension)*)?),)*)*
                }
            }

            fn target_system_id_mut(&mut self) -> Option<&mut u8> {
                match self {
                    $($(Self::$name(message) => field_named!(system_mut message: $($field)* $($($extension)*)?),)*)*
                }
            }

            fn target_component_id_mut(&mut self) -> Option<&mut u8> {
                match self {
                    $($(Self::$name(message) => field_named!(component_mut message: $($field)* $($($extension)*)?),)*)*
                }
            }

            fn ser(&self, version: MavlinkVersion, payload: &mut [u8]) -> usize {
                match self {
                    $($(Self::$name(message) => message.ser(version, payload),)*)*
                }
            }

            fn parse(version: MavlinkVersion, id: u32, payload: &[u8]) -> Result<Self, ParserError> {
                match id {
                    $($($id => $data::deser(version, payload).map(Self::$name),)*)*
                    _ => Err(ParserError::UnknownMessage { id }),
                }
            }

            fn message_id_from_name(name: &str) -> Option<u32> {
                match name {
                    $($($data::NAME => Some($id),)*)*
                    _ => None,
                }
            }

            fn default_message_from_id(id: u32) -> Option<Self> {
                match id {
                    $($($id => Some(Self::$name($data::DEFAULT)),)*)*
                    _ => None,
                }
            }

            /// Extra byte of the CRC; zero of a message that neither the table nor the common dialect has.
            fn extra_crc(id: u32) -> u8 {
                match id {
                    $($($id => $crc,)*)*
                    _ => common_extra_crc(id),
                }
            }
        }
    };
}

/// A field of `$message` for its addressee, if it is among the fields named.
macro_rules! field_named {
    (system $message:ident: target_system $($rest:ident)*) => { Some($message.target_system) };
    (component $message:ident: target_component $($rest:ident)*) => { Some($message.target_component) };
    (system_mut $message:ident: target_system $($rest:ident)*) => { Some(&mut $message.target_system) };
    (component_mut $message:ident: target_component $($rest:ident)*) => { Some(&mut $message.target_component) };
    ($wanted:ident $message:ident: $other:ident $($rest:ident)*) => { field_named!($wanted $message: $($rest)*) };
    ($wanted:ident $message:ident:) => {{
        let _ = $message;
        None
    }};
}

message_table!(define_messages);
