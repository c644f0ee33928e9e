//! Hand-over to the boot loader for a firmware update over the bus.

use crate::wire::dronecan::{MAX_PATH_LENGTH, NodeId};

/// Accepted request to load another firmware. The board's boot loader fetches it after a restart.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UpdateForBootLoader {
    /// Node with the file.
    pub server_node: NodeId,
    /// Number of this node, which the boot loader keeps.
    pub own_node: NodeId,
    path: heapless::Vec<u8, MAX_PATH_LENGTH>,
}

/// Size of the structure that ArduPilot's boot loaders read, bytes.
pub const BOOT_LOADER_HANDOVER_LENGTH: usize = 224;

impl UpdateForBootLoader {
    /// An update by a path of 1 to 200 bytes without NUL; `None` for another path.
    pub(super) fn new(server: NodeId, own_node: NodeId, path: &[u8]) -> Option<Self> {
        let path = heapless::Vec::from_slice(path).ok()?;
        (!path.is_empty() && !path.contains(&0)).then_some(Self { server_node: server, own_node, path })
    }

    /// Path of the file at the server.
    #[must_use]
    pub fn file_path(&self) -> &[u8] {
        &self.path
    }

    /// Structure at the begin of the RAM for ArduPilot's boot loaders (`app_bootloader_comms` in app_comms.h): magic
    /// number, twelve bytes for Ethernet, server, own number, path with its NUL. All bytes are to be written.
    #[must_use]
    pub fn boot_loader_handover(&self) -> [u8; BOOT_LOADER_HANDOVER_LENGTH] {
        const BOOT_LOADER_MAGIC: u32 = 0xC544_AD9A;
        const SERVER_NODE_OFFSET: usize = 20;
        const OWN_NODE_OFFSET: usize = 21;
        const PATH_OFFSET: usize = 22;
        const _: () = assert!(PATH_OFFSET + MAX_PATH_LENGTH < BOOT_LOADER_HANDOVER_LENGTH);
        let mut bytes = [0; BOOT_LOADER_HANDOVER_LENGTH];
        let fields = BOOT_LOADER_MAGIC.to_le_bytes().into_iter().enumerate();
        let nodes = [(SERVER_NODE_OFFSET, self.server_node.number()), (OWN_NODE_OFFSET, self.own_node.number())];
        let path = self.path.iter().copied().enumerate().map(|(at, byte)| (PATH_OFFSET + at, byte));
        for (at, byte) in fields.chain(nodes).chain(path) {
            if let Some(place) = bytes.get_mut(at) {
                *place = byte;
            }
        }
        bytes
    }
}
