//! Latency of a heading that was removed.

use std::fmt;

/// Latency of a heading that was removed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadingLatency {
    /// Name of the heading.
    pub heading_name: &'static str,
    /// Latency, seconds.
    pub latency_s: f64,
}

impl fmt::Display for HeadingLatency {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { heading_name, latency_s } = self;
        write!(f, "{heading_name} is {:.0} ms late by the body rates; this is allowed for", latency_s * 1e3)
    }
}
