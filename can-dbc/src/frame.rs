//! A CAN frame, classic or FD, as a small `Copy` value.

use embedded_can::{ExtendedId, Id, StandardId};

/// Payload lengths CAN FD knows above the classic eight bytes, ISO 11898-1.
pub(crate) const FD_LENGTHS: [usize; 7] = [12, 16, 20, 24, 32, 48, 64];
const CLASSIC_CAPACITY: usize = 8;
const STANDARD_ID_MAX: u32 = 0x7FF;
const EXTENDED_ID_MAX: u32 = 0x1FFF_FFFF;

/// What a frame is besides its identifier and data.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct FrameFlags {
    /// 29-bit identifier.
    pub is_extended: bool,
    /// CAN FD frame.
    pub is_fd: bool,
    /// Bit rate switch: the data phase ran at the higher rate.
    pub brs: bool,
    /// Error state indicator: the sender was error passive.
    pub esi: bool,
    /// Remote request; it has a length but no data.
    pub is_rtr: bool,
    /// Error frame of the driver; the identifier holds the error classes.
    pub is_error: bool,
}

impl FrameFlags {
    /// A classic data frame with an 11-bit identifier.
    pub const CLASSIC: Self = Self {
        is_extended: false,
        is_fd: false,
        brs: false,
        esi: false,
        is_rtr: false,
        is_error: false,
    };
}

/// A CAN frame. Accepts any traffic of a bus, not only the contract's, so that it can be recorded.
///
/// Two frames are equal when identifier, flags, length and the data up to that length are.
#[derive(Clone, Copy)]
pub struct Frame {
    id: u32,
    flags: FrameFlags,
    length: u8,
    /// Zero beyond `length`.
    payload: [u8; Self::CAPACITY],
}

/// Why there can be no such frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// The identifier has more bits than its format.
    #[error("the identifier has more bits than its format")]
    Id,
    /// No frame of this kind has this payload length.
    #[error("no frame of this kind has this payload length")]
    Length,
    /// The flags exclude each other, such as FD and remote request.
    #[error("the flags exclude each other")]
    Flags,
}

impl Frame {
    /// Largest payload in bytes.
    pub const CAPACITY: usize = 64;

    /// A frame with this identifier (without any flag bit), flags and data.
    ///
    /// # Errors
    /// [`FrameError`] when the CAN standard knows no such frame.
    pub fn new(id: u32, flags: FrameFlags, data: &[u8]) -> Result<Self, FrameError> {
        if flags.is_rtr {
            return Err(FrameError::Flags);
        }
        Self::build(id, flags, data.len(), data)
    }

    /// A remote request for `length` bytes.
    ///
    /// # Errors
    /// [`FrameError`] when the identifier or the length is too large.
    pub fn remote(id: u32, is_extended: bool, length: usize) -> Result<Self, FrameError> {
        let flags = FrameFlags { is_extended, is_rtr: true, ..FrameFlags::default() };
        Self::build(id, flags, length, &[])
    }

    /// A frame of any kind; `length` differs from `data.len()` for remote requests only.
    pub(crate) fn build(
        id: u32,
        flags: FrameFlags,
        length: usize,
        data: &[u8],
    ) -> Result<Self, FrameError> {
        // The classes of an error frame use the bits of an extended identifier.
        let is_wide = flags.is_extended || flags.is_error;
        if id > if is_wide { EXTENDED_ID_MAX } else { STANDARD_ID_MAX } {
            return Err(FrameError::Id);
        }
        let only_classic = flags.is_rtr || flags.is_error;
        if (flags.is_fd && only_classic) || (!flags.is_fd && (flags.brs || flags.esi)) {
            return Err(FrameError::Flags);
        }
        let fits = length <= CLASSIC_CAPACITY || (flags.is_fd && FD_LENGTHS.contains(&length));
        if !fits || data.len() != if flags.is_rtr { 0 } else { length } {
            return Err(FrameError::Length);
        }
        let mut payload = [0; Self::CAPACITY];
        payload[..data.len()].copy_from_slice(data);
        Ok(Self { id, flags, length: length as u8, payload })
    }

    /// An extended frame, classic or FD with bit rate switch, whose parts the DBC has already
    /// vouched for.
    pub(crate) fn sealed(
        id: u32,
        is_fd: bool,
        length: usize,
        payload: [u8; Self::CAPACITY],
    ) -> Self {
        debug_assert!(id <= EXTENDED_ID_MAX && length <= Self::CAPACITY);
        let flags = FrameFlags { is_extended: true, is_fd, brs: is_fd, ..FrameFlags::default() };
        Self { id, flags, length: length as u8, payload }
    }

    /// The identifier: 29 or 11 bits, never a flag. For an error frame, the error classes.
    pub const fn id(&self) -> u32 {
        self.id
    }

    /// All flags.
    pub const fn flags(&self) -> FrameFlags {
        self.flags
    }

    /// The data; empty for a remote request.
    pub fn data(&self) -> &[u8] {
        let length = if self.flags.is_rtr { 0 } else { usize::from(self.length) };
        &self.payload[..length]
    }

    /// The length field in bytes: that of the data, or the one a remote request asks for.
    pub const fn length(&self) -> usize {
        self.length as usize
    }

    /// The data followed by zeros.
    pub(crate) const fn payload(&self) -> &[u8; Self::CAPACITY] {
        &self.payload
    }
}

impl PartialEq for Frame {
    fn eq(&self, other: &Self) -> bool {
        (self.id, self.flags, self.length) == (other.id, other.flags, other.length)
            && self.data() == other.data()
    }
}

impl Eq for Frame {}

impl std::fmt::Debug for Frame {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Frame")
            .field("id", &format_args!("0x{:X}", self.id))
            .field("flags", &self.flags)
            .field("length", &self.length)
            .field("data", &format_args!("{:02X?}", self.data()))
            .finish()
    }
}

impl embedded_can::Frame for Frame {
    /// A classic frame up to eight bytes, an FD frame with bit rate switch above.
    fn new(id: impl Into<Id>, data: &[u8]) -> Option<Self> {
        let (id, is_extended) = split(id.into());
        let is_fd = data.len() > CLASSIC_CAPACITY;
        let flags = FrameFlags { is_extended, is_fd, brs: is_fd, ..FrameFlags::default() };
        Self::new(id, flags, data).ok()
    }

    fn new_remote(id: impl Into<Id>, dlc: usize) -> Option<Self> {
        let (id, is_extended) = split(id.into());
        Self::remote(id, is_extended, dlc).ok()
    }

    fn is_extended(&self) -> bool {
        self.flags.is_extended
    }

    fn is_remote_frame(&self) -> bool {
        self.flags.is_rtr
    }

    fn id(&self) -> Id {
        // Error classes are wider than a standard identifier.
        match StandardId::new(self.id as u16) {
            Some(id) if self.id <= STANDARD_ID_MAX && !self.flags.is_extended => Id::Standard(id),
            _ => Id::Extended(ExtendedId::new(self.id).unwrap_or(ExtendedId::MAX)),
        }
    }

    fn dlc(&self) -> usize {
        self.length()
    }

    fn data(&self) -> &[u8] {
        self.data()
    }
}

fn split(id: Id) -> (u32, bool) {
    match id {
        Id::Standard(id) => (u32::from(id.as_raw()), false),
        Id::Extended(id) => (id.as_raw(), true),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_the_standard_does_not_know_are_refused() {
        let fd = FrameFlags { is_fd: true, ..FrameFlags::CLASSIC };
        assert_eq!(Frame::new(0x800, FrameFlags::CLASSIC, &[]), Err(FrameError::Id));
        let extended = FrameFlags { is_extended: true, ..FrameFlags::CLASSIC };
        assert_eq!(Frame::new(0x2000_0000, extended, &[]), Err(FrameError::Id));
        assert_eq!(Frame::new(1, FrameFlags::CLASSIC, &[0; 9]), Err(FrameError::Length));
        assert_eq!(Frame::new(1, fd, &[0; 9]), Err(FrameError::Length));
        assert_eq!(Frame::new(1, fd, &[0; 65]), Err(FrameError::Length));
        assert_eq!(
            Frame::new(1, FrameFlags { brs: true, ..FrameFlags::CLASSIC }, &[]),
            Err(FrameError::Flags)
        );
        assert_eq!(Frame::new(1, FrameFlags { is_error: true, ..fd }, &[]), Err(FrameError::Flags));
        assert_eq!(Frame::remote(1, false, 9), Err(FrameError::Length));
    }

    #[test]
    fn equality_ignores_bytes_beyond_the_length() {
        let short = Frame::sealed(1, true, 3, [7; 64]);
        let mut other = [7; 64];
        other[3] = 0;
        assert_eq!(short, Frame::sealed(1, true, 3, other));
        assert_ne!(short, Frame::sealed(1, true, 8, other));
    }

    #[test]
    fn a_remote_request_has_a_length_and_no_data() {
        let remote = Frame::remote(0x123, false, 5).expect("valid");
        assert_eq!((remote.length(), remote.data()), (5, &[][..]));
    }
}
