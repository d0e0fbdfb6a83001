//! Signals over time, decoded from frames by the DBC.

use std::collections::BTreeMap;

use platoon_dbc::Reading;
use traces::FrameRecord;

/// What a signal is called: bus, message, signal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SignalName {
    /// Bus it is on; bus i is truck i's.
    pub bus: u8,
    /// Message, as the DBC calls it.
    pub message: &'static str,
    /// Signal, as the DBC calls it.
    pub signal: &'static str,
    /// Page of a multiplexed message.
    pub page: Option<u32>,
}

impl core::fmt::Display for SignalName {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "bus{}.{}.{}", self.bus, self.message, self.signal)
    }
}

/// One signal over time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Series {
    /// Unit as the DBC writes it; empty when dimensionless.
    pub unit: &'static str,
    /// Bench times \[ns\].
    pub time_ns: Vec<u64>,
    /// Values in `unit`; not a number where the sender had none.
    pub values: Vec<f64>,
}

impl Series {
    /// Decodes a frame and appends each signal that `wants` accepts to its series.
    pub fn collect(
        into: &mut BTreeMap<SignalName, Self>,
        record: &FrameRecord,
        mut wants: impl FnMut(&SignalName) -> bool,
    ) {
        let Some(message) = platoon_dbc::message_info(record.frame.id()) else { return };
        platoon_dbc::decode_signals(&record.frame, &mut |signal, _, reading| {
            let page = signal.multiplexed;
            let (bus, message, signal_name) = (record.bus, message.name, signal.name);
            let name = SignalName { bus, message, signal: signal_name, page };
            if !wants(&name) {
                return;
            }
            let series =
                into.entry(name).or_insert_with(|| Self { unit: signal.unit, ..Self::default() });
            series.time_ns.push(record.time_ns);
            series.values.push(match reading {
                Reading::Value(value) => value,
                Reading::Error | Reading::NotAvailable => f64::NAN,
            });
        });
    }
}
