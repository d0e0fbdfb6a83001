//! Where signals lie: counters and checksums in place, nothing overlapping, pages alike.

use super::model::{integer, positive};
use super::signal::Signal;
use can_dbc::{Dbc, MessageId};

/// Names of the signals that belong to the protection and are no fields.
pub(crate) const RESERVED: [&str; 4] = [E2E_CRC, E2E_COUNTER, COUNTER, CHECKSUM];
const E2E_CRC: &str = "E2eCrc";
const E2E_COUNTER: &str = "E2eCounter";
const COUNTER: &str = "MessageCounter";
const CHECKSUM: &str = "MessageChecksum";

/// How a message is protected.
#[derive(Clone, Copy)]
pub(crate) enum Protection {
    None,
    /// AUTOSAR E2E Profile 5 with this Data ID.
    E2eP05(u64),
    /// J1939's own for TSC1, and for XBR.
    Tsc1,
    Xbr,
    /// CRC-8 in the last byte.
    Crc8,
}

impl Protection {
    /// From the attributes: `E2EDataId` for CAN FD, `Protection` for J1939.
    pub(crate) fn read(dbc: &Dbc, id: MessageId, is_fd: bool) -> Result<Self, String> {
        if is_fd {
            return positive(dbc, id, "E2EDataId").map(Self::E2eP05);
        }
        match dbc.message_attribute(id, "Protection").and_then(integer) {
            None | Some(0) => Ok(Self::None),
            Some(1) => Ok(Self::Tsc1),
            Some(2) => Ok(Self::Xbr),
            Some(3) => Ok(Self::Crc8),
            Some(other) => Err(format!("Protection {other} is not generated; 0 to 3 are")),
        }
    }

    pub(crate) fn data_id(self) -> Option<u64> {
        match self {
            Self::E2eP05(data_id) => Some(data_id),
            _ => None,
        }
    }

    /// Signals the protection needs, with first bit and size.
    fn signals(self) -> &'static [(&'static str, u32, u32)] {
        match self {
            Self::None => &[],
            // AUTOSAR E2E Profile 5, offset 0.
            Self::E2eP05(_) => &[(E2E_CRC, 0, 16), (E2E_COUNTER, 16, 8)],
            Self::Tsc1 | Self::Xbr => &[(COUNTER, 56, 4), (CHECKSUM, 60, 4)],
            Self::Crc8 => &[(CHECKSUM, 56, 8)],
        }
    }
}

/// How a multiplexed message is cut into pages of equal content.
pub(crate) struct Pages {
    /// Index of the multiplexor and of the first paged signal in `Message::signals`.
    pub(crate) multiplexor: usize,
    pub(crate) first: usize,
    /// Signals per page, and number of pages.
    pub(crate) stride: usize,
    pub(crate) count: usize,
}

/// The alive counter's index.
pub(crate) fn find_counter(signals: &[Signal]) -> Option<usize> {
    signals.iter().position(|signal| [E2E_COUNTER, COUNTER].contains(&signal.name.as_str()))
}

/// Protection in place, and nothing overlapping.
pub(crate) fn check(signals: &[Signal], protection: Protection) -> Result<(), String> {
    for (name, start_bit, size) in protection.signals() {
        let fits = |signal: &Signal| {
            signal.name == *name && (signal.start_bit, signal.size) == (*start_bit, *size)
        };
        if !signals.iter().any(fits) {
            return Err(format!("{name} must be at {start_bit}|{size} by its protection"));
        }
    }
    let is_loose = |signal: &&Signal| {
        [E2E_CRC, CHECKSUM].contains(&signal.name.as_str())
            && !protection.signals().iter().any(|(name, ..)| *name == signal.name)
    };
    if let Some(signal) = signals.iter().find(is_loose) {
        return Err(format!("{} without the attribute that says how it is made", signal.name));
    }
    if let Some(counter) = find_counter(signals).map(|index| &signals[index])
        && (counter.size > 8 || counter.raw_min != 0)
    {
        return Err(format!("{} must count from 0 in at most 8 bits", counter.name));
    }
    check_overlaps(signals)
}

fn check_overlaps(signals: &[Signal]) -> Result<(), String> {
    for (index, signal) in signals.iter().enumerate() {
        let end_bit = signal.start_bit + signal.size;
        if let Some(other) = signals[index + 1..].iter().find(|other| {
            let shares_frame = signal.page.is_none() || other.page == signal.page;
            let other_end_bit = other.start_bit + other.size;
            shares_frame && other.start_bit < end_bit && signal.start_bit < other_end_bit
        }) {
            return Err(format!("signals {} and {} overlap", signal.name, other.name));
        }
    }
    Ok(())
}

/// Cuts sorted signals into pages, which must be 0, 1, 2... and alike but for their suffix.
pub(crate) fn find_pages(signals: &[Signal]) -> Result<Option<Pages>, String> {
    let Some(first) = signals.iter().position(|signal| signal.page.is_some()) else {
        return Ok(None);
    };
    let multiplexor = signals.iter().position(|signal| signal.is_multiplexor);
    let multiplexor = multiplexor.ok_or("it has mN signals but no multiplexor M")?;
    let paged = &signals[first..];
    let stride = paged.iter().filter(|signal| signal.page == paged[0].page).count();
    for (index, signal) in paged.iter().enumerate() {
        let page = (index / stride) as u64;
        let model = &paged[index % stride];
        let alike = signal.page == Some(page)
            && base_name(signal, page)? == base_name(model, 0)?
            && signal.start_bit == model.start_bit
            && are_alike(signal, model);
        if !alike {
            return Err(format!("signal {}: pages must be alike and count from 0", signal.name));
        }
    }
    let count = paged.len() / stride;
    if !paged.len().is_multiple_of(stride) || signals[multiplexor].raw_max + 1 != count as i64 {
        return Err(format!("the multiplexor's range must be its {count} whole pages"));
    }
    Ok(Some(Pages { multiplexor, first, stride, count }))
}

/// Length of the series that begins with the first signal: `Speed_0`, `Speed_1` and so on, on no
/// page and alike; `None` when none begins there.
pub(crate) fn series(signals: &[Signal]) -> Result<Option<usize>, String> {
    let Some((first, rest)) = signals.split_first() else { return Ok(None) };
    let (None, Ok(base)) = (first.page, base_name(first, 0)) else { return Ok(None) };
    let is_member = |(index, signal): (usize, &Signal)| {
        base_name(signal, index as u64 + 1).is_ok_and(|name| name == base)
    };
    let more = rest.iter().enumerate().take_while(|&member| is_member(member)).count();
    let is_number = first.codes.is_none() && first.values.is_empty() && first.factor != 1.0;
    match rest[..more].iter().find(|signal| !is_number || !are_alike(signal, first)) {
        Some(signal) => Err(format!("signal {}: a series is of scaled, like numbers", signal.name)),
        None if more == 0 => Ok(None),
        None => Ok(Some(more + 1)),
    }
}

/// Whether two signals carry the same kind of value.
fn are_alike(signal: &Signal, model: &Signal) -> bool {
    (signal.size, signal.signed) == (model.size, model.signed)
        && (signal.factor, signal.offset, &signal.unit, &signal.values)
            == (model.factor, model.offset, &model.unit, &model.values)
}

/// `Kind_3` of page 3, or member 3 of a series, is `Kind`.
pub(crate) fn base_name(signal: &Signal, number: u64) -> Result<&str, String> {
    let suffix = format!("_{number}");
    let base = signal.name.strip_suffix(suffix.as_str());
    base.ok_or_else(|| {
        format!("signal {}: as number {number} it must end in {suffix}", signal.name)
    })
}
