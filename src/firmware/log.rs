//! Logging: defmt on a board, nothing on a host.

macro_rules! info {
    ($($arg:tt)*) => {{
        #[cfg(target_os = "none")]
        defmt::info!($($arg)*);
        #[cfg(not(target_os = "none"))]
        $crate::log::discard!($($arg)*);
    }};
}

macro_rules! warning {
    ($($arg:tt)*) => {{
        #[cfg(target_os = "none")]
        defmt::warn!($($arg)*);
        #[cfg(not(target_os = "none"))]
        $crate::log::discard!($($arg)*);
    }};
}

/// Uses the arguments, to avoid warnings about unused values on a host.
#[cfg(not(target_os = "none"))]
macro_rules! discard {
    ($format:literal $(, $arg:expr)* $(,)?) => {{
        $( let _ = &$arg; )*
    }};
}

#[cfg(not(target_os = "none"))]
pub(crate) use discard;
pub(crate) use {info, warning};
