//! Numbers and flags in the fields of messages.

use core::ops::BitOr;

use crate::field::MessageField;

/// Passes the table to the macro `$process`. An `enumeration` is one of its numbers, a `bitmask` a sum of them. The
/// numbers that the project names are listed; a field may have any.
macro_rules! enumeration_table {
    ($process:ident) => {
        $process! {
            enumeration MavType: u8 {
                MAV_TYPE_GENERIC = 0, MAV_TYPE_FIXED_WING = 1, MAV_TYPE_QUADROTOR = 2, MAV_TYPE_GCS = 6,
                MAV_TYPE_GROUND_ROVER = 10, MAV_TYPE_SURFACE_BOAT = 11, MAV_TYPE_ONBOARD_CONTROLLER = 18,
                MAV_TYPE_VTOL_FIXEDROTOR = 22,
            }
            enumeration MavAutopilot: u8 {
                MAV_AUTOPILOT_GENERIC = 0, MAV_AUTOPILOT_ARDUPILOTMEGA = 3, MAV_AUTOPILOT_INVALID = 8,
                MAV_AUTOPILOT_PX4 = 12,
            }
            bitmask MavModeFlag: u8 {
                MAV_MODE_FLAG_SAFETY_ARMED = 128, MAV_MODE_FLAG_CUSTOM_MODE_ENABLED = 1,
            }
            enumeration MavState: u8 {
                MAV_STATE_UNINIT = 0, MAV_STATE_CALIBRATING = 2, MAV_STATE_STANDBY = 3, MAV_STATE_ACTIVE = 4,
                MAV_STATE_CRITICAL = 5,
            }
            bitmask MavSysStatusSensor: u32 { MAV_SYS_STATUS_SENSOR_3D_GYRO = 1 }
            bitmask MavSysStatusSensorExtended: u32 { MAV_SYS_STATUS_RECOVERY_SYSTEM = 1 }
            enumeration MavParamType: u8 {
                MAV_PARAM_TYPE_UINT8 = 1, MAV_PARAM_TYPE_INT8 = 2, MAV_PARAM_TYPE_UINT16 = 3,
                MAV_PARAM_TYPE_INT16 = 4, MAV_PARAM_TYPE_UINT32 = 5, MAV_PARAM_TYPE_INT32 = 6,
                MAV_PARAM_TYPE_REAL32 = 9,
            }
            enumeration GpsFixType: u8 {
                GPS_FIX_TYPE_NO_GPS = 0, GPS_FIX_TYPE_2D_FIX = 2, GPS_FIX_TYPE_3D_FIX = 3,
                GPS_FIX_TYPE_RTK_FIXED = 6,
            }
            enumeration MavDataStream: u8 { MAV_DATA_STREAM_ALL = 0, MAV_DATA_STREAM_EXTRA1 = 10 }
            enumeration MavCmd: u16 {
                MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN = 246, MAV_CMD_SET_MESSAGE_INTERVAL = 511,
                MAV_CMD_USER_1 = 31010,
            }
            enumeration MavFrame: u8 { MAV_FRAME_GLOBAL = 0 }
            enumeration MavResult: u8 {
                MAV_RESULT_ACCEPTED = 0, MAV_RESULT_TEMPORARILY_REJECTED = 1, MAV_RESULT_DENIED = 2,
                MAV_RESULT_UNSUPPORTED = 3, MAV_RESULT_FAILED = 4, MAV_RESULT_IN_PROGRESS = 5,
            }
            bitmask HighresImuUpdatedFlags: u16 {
                HIGHRES_IMU_UPDATED_XACC = 1, HIGHRES_IMU_UPDATED_XMAG = 64, HIGHRES_IMU_UPDATED_YMAG = 128,
                HIGHRES_IMU_UPDATED_ZMAG = 256,
            }
            enumeration MavBatteryFunction: u8 { MAV_BATTERY_FUNCTION_UNKNOWN = 0 }
            enumeration MavBatteryType: u8 { MAV_BATTERY_TYPE_UNKNOWN = 0 }
            enumeration MavBatteryChargeState: u8 { MAV_BATTERY_CHARGE_STATE_UNDEFINED = 0 }
            enumeration MavBatteryMode: u8 { MAV_BATTERY_MODE_UNKNOWN = 0 }
            bitmask MavBatteryFault: u32 { MAV_BATTERY_FAULT_DEEP_DISCHARGE = 1 }
            enumeration MagCalStatus: u8 {
                MAG_CAL_NOT_STARTED = 0, MAG_CAL_RUNNING_STEP_ONE = 2, MAG_CAL_RUNNING_STEP_TWO = 3,
                MAG_CAL_SUCCESS = 4, MAG_CAL_FAILED = 5,
            }
            enumeration MavSensorOrientation: u8 { MAV_SENSOR_ROTATION_NONE = 0 }
            enumeration MavSeverity: u8 {
                MAV_SEVERITY_EMERGENCY = 0, MAV_SEVERITY_CRITICAL = 2, MAV_SEVERITY_WARNING = 4,
                MAV_SEVERITY_INFO = 6,
            }
        }
    };
}

macro_rules! define_enumerations {
    ($($kind:ident $name:ident: $number:ty { $($entry:ident = $value:literal),* $(,)? })*) => {
        $(
            #[doc = concat!("`", stringify!($name), "`: a number, or flags, as the protocol defines them.")]
            #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
            pub struct $name(pub $number);

            impl $name {
                $(
                    #[doc = concat!("`", stringify!($entry), "`: ", stringify!($value), ".")]
                    pub const $entry: Self = Self($value);
                )*
            }

            impl MessageField for $name {
                const LENGTH: usize = <$number>::LENGTH;
                const ZERO: Self = Self(0);

                fn write(self, bytes: &mut [u8]) -> &mut [u8] {
                    self.0.write(bytes)
                }

                fn read(bytes: &[u8]) -> (Self, &[u8]) {
                    let (number, rest) = <$number>::read(bytes);
                    (Self(number), rest)
                }

                fn from_numbers(number_at: &mut dyn FnMut(usize) -> f64) -> Self {
                    Self(<$number>::from_numbers(number_at))
                }
            }

            define_flags! { $kind $name: $number }
        )*
    };
}

macro_rules! define_flags {
    (enumeration $name:ident: $number:ty) => {};
    (bitmask $name:ident: $number:ty) => {
        impl $name {
            /// No flag.
            #[must_use]
            pub const fn empty() -> Self {
                Self(0)
            }

            /// All flags, unnamed ones included.
            #[must_use]
            pub const fn all() -> Self {
                Self(<$number>::MAX)
            }

            /// The flags as a number.
            #[must_use]
            pub const fn bits(self) -> $number {
                self.0
            }

            /// Whether all of `flags` are set.
            #[must_use]
            pub const fn contains(self, flags: Self) -> bool {
                self.0 & flags.0 == flags.0
            }

            /// Sets or clears flags.
            pub const fn set(&mut self, flags: Self, is_set: bool) {
                self.0 = if is_set { self.0 | flags.0 } else { self.0 & !flags.0 };
            }
        }

        impl BitOr for $name {
            type Output = Self;

            fn bitor(self, other: Self) -> Self {
                Self(self.0 | other.0)
            }
        }
    };
}

enumeration_table!(define_enumerations);
