//! State of a collection, and what its caller stores with it.

/// State of a collection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CollectionState {
    /// No collection is active: finished, or never started.
    Inactive,
    /// The collection is stopped; the samples wait for the solver.
    Stopped,
    /// The collection is running.
    Running,
}

/// Caller's data stored together with a collection.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CollectionContext {
    /// Whether the module started the collection automatically.
    pub is_automatic: bool,
    /// Serial number of the active calibration when the collection was last saved.
    pub calibration_serial: u32,
}
