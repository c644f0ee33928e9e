//! Latency of a heading that was removed.

/// Latency of a heading that was removed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadingLatency {
    /// Name of the heading.
    pub heading_name: &'static str,
    /// Latency, seconds.
    pub latency_s: f64,
}
