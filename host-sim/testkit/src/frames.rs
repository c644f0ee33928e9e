//! Frames of autopilots, built from the definitions of the protocols. The checksums are computed bit by bit,
//! independent of the library's tables.

/// Sender or addressee of a MAVLink message: system and component.
pub type MavlinkAddress = [u8; 2];

/// Bytes of hexadecimal digits, between which other characters are ignored.
#[must_use]
pub fn bytes_from_hex(hex: &str) -> Vec<u8> {
    let digits: Vec<u8> = hex.chars().filter_map(|digit| digit.to_digit(16)).map(|digit| digit as u8).collect();
    digits.chunks(2).map(|pair| pair.iter().fold(0, |byte, digit| byte << 4 | digit)).collect()
}

/// Appends the CRC of a MAVLink frame: of all its bytes but the first, and of the message's extra byte
/// (CRC-16/MCRF4XX; mavlink.io, "Serialization").
#[must_use]
pub fn with_mavlink_crc(mut frame: Vec<u8>, extra_crc: u8) -> Vec<u8> {
    let checked = frame.iter().skip(1).chain([&extra_crc]);
    let crc = checked.fold(0xFFFF_u16, |crc, &byte| {
        (0..8).fold(crc ^ u16::from(byte), |crc, _| if crc & 1 == 0 { crc >> 1 } else { crc >> 1 ^ 0x8408 })
    });
    frame.extend(crc.to_le_bytes());
    frame
}

/// Frame of MAVLink 1.
#[must_use]
pub fn mavlink_v1_frame([system, component]: MavlinkAddress, id: u8, extra_crc: u8, payload: &[u8]) -> Vec<u8> {
    with_mavlink_crc([&[0xFE, payload.len() as u8, 0, system, component, id], payload].concat(), extra_crc)
}

/// Unsigned frame of MAVLink 2.
#[must_use]
pub fn mavlink_v2_frame([system, component]: MavlinkAddress, id: u8, extra_crc: u8, payload: &[u8]) -> Vec<u8> {
    let header = [0xFD, payload.len() as u8, 0, 0, 0, system, component, id, 0, 0];
    with_mavlink_crc([&header, payload].concat(), extra_crc)
}

/// HEARTBEAT of ArduPilot, or of a component that is no autopilot.
#[must_use]
pub fn mavlink_heartbeat(sender: MavlinkAddress, is_autopilot: bool, is_armed: bool) -> Vec<u8> {
    let (autopilot, base_mode) = (if is_autopilot { 3 } else { 8 }, if is_armed { 0x80 } else { 0 });
    mavlink_v2_frame(sender, 0, 50, &[0, 0, 0, 0, 1, autopilot, base_mode, 4, 3])
}

/// ATTITUDE: the autopilot's clock, milliseconds; roll, pitch and yaw, radians; their rates, rad/s.
#[must_use]
pub fn mavlink_attitude(sender: MavlinkAddress, boot_ms: u32, angles_and_rates: [f32; 6]) -> Vec<u8> {
    mavlink_v2_frame(sender, 30, 39, &mavlink_attitude_payload(boot_ms, angles_and_rates))
}

/// Payload of ATTITUDE, as in [`mavlink_attitude`].
#[must_use]
pub fn mavlink_attitude_payload(boot_ms: u32, angles_and_rates: [f32; 6]) -> Vec<u8> {
    boot_ms.to_le_bytes().into_iter().chain(angles_and_rates.into_iter().flat_map(f32::to_le_bytes)).collect()
}

/// COMMAND_LONG with its number of repetitions, and the first of its seven parameters; the others are zero.
#[must_use]
pub fn mavlink_command(
    sender: MavlinkAddress,
    target: MavlinkAddress,
    command: u16,
    confirmation: u8,
    first_parameters: [f32; 4],
) -> Vec<u8> {
    let mut payload = first_parameters.map(f32::to_le_bytes).concat();
    payload.resize(28, 0);
    payload.extend(command.to_le_bytes());
    payload.extend(target);
    payload.push(confirmation);
    mavlink_v2_frame(sender, 76, 152, &payload)
}

/// Frame of MSP version 2; `direction` is `<` for a request, `>` for a reply, `!` for a refusal.
#[must_use]
pub fn msp_frame(direction: u8, function: u16, payload: &[u8]) -> Vec<u8> {
    let [f0, f1] = function.to_le_bytes();
    let [n0, n1] = (payload.len() as u16).to_le_bytes();
    let checked = [&[0, f0, f1, n0, n1], payload].concat();
    let crc = crc_8_dvb_s2(&checked);
    [&[b'$', b'X', direction], &checked[..], &[crc]].concat()
}

/// CRC-8/DVB-S2: polynomial 0xD5, initial value 0, no final XOR.
#[must_use]
pub fn crc_8_dvb_s2(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |crc, byte| {
        (0..8).fold(crc ^ byte, |crc: u8, _| if crc & 0x80 == 0 { crc << 1 } else { (crc << 1) ^ 0xD5 })
    })
}
