//! State of a collection, and what its caller stores with it.

/// State of a collection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CollectionState {
    /// None active: finished, or never started.
    Inactive,
    /// Stopped; the samples wait for the solver.
    Stopped,
    /// The collection is running.
    Running,
}

/// Caller's data stored together with a collection.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CollectionContext {
    /// Whether the module started the collection automatically.
    pub is_automatic: bool,
    /// Serial number of the active calibration at that time.
    pub calibration_serial: u32,
}
