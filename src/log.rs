//! Logging: defmt on a board, nothing on the host (where the simulator watches the module from outside).

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

/// Uses the arguments, so that a value that is only logged is no warning on the host.
#[cfg(not(target_os = "none"))]
macro_rules! discard {
    ($format:literal $(, $arg:expr)* $(,)?) => {{
        $( let _ = &$arg; )*
    }};
}

#[cfg(not(target_os = "none"))]
pub(crate) use discard;
pub(crate) use {info, warning};
