//! The profile `fd`: one frame of `platoon.dbc` per message, protected by AUTOSAR E2E Profile 5.

use super::{Heard, Refusal};
use crate::codec::EncodeError;
use crate::e2e::{Continuity, Supervisor};
use crate::frame::Frame;
use crate::messages::{MESSAGES, Message};
use serde::{Deserialize, Serialize};

/// Messages of `platoon.dbc`.
const KINDS: usize = 9;
const _: () = assert!(MESSAGES.len() == KINDS);

/// One alive counter per message.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Encoder {
    alive: [u8; KINDS],
}

impl Encoder {
    pub(super) fn encode(
        &mut self,
        message: &Message,
        emit: &mut dyn FnMut(&Frame),
    ) -> Result<(), EncodeError> {
        let alive = &mut self.alive[message.index()];
        let frame = message.encode(*alive)?;
        *alive = alive.wrapping_add(1);
        emit(&frame);
        Ok(())
    }
}

/// One supervisor per message.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Decoder {
    supervisors: [Supervisor; KINDS],
}

impl Decoder {
    pub(super) fn take(&mut self, frame: &Frame) -> Result<Heard, Refusal> {
        let (message, counter) = Message::decode(frame)?;
        let lost = match self.supervisors[message.index()].see(counter) {
            Continuity::Repeated => return Err(Refusal::Repeated),
            Continuity::Lost(missing) => u32::from(missing),
            Continuity::First | Continuity::Ok => 0,
        };
        Ok(Heard { message: Some(message), lost })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::EgoState;

    fn frames(encoder: &mut Encoder, ticks: std::ops::Range<u32>) -> Vec<Frame> {
        let mut frames = Vec::new();
        for tick in ticks {
            let message = Message::EgoState(EgoState { tick, ..EgoState::default() });
            encoder.encode(&message, &mut |frame| frames.push(*frame)).expect("in range");
        }
        frames
    }

    #[test]
    fn every_message_is_one_frame_and_a_missing_one_is_counted_by_the_next() {
        let sent = frames(&mut Encoder::default(), 0..300);
        let mut decoder = Decoder::default();
        let (mut lost, mut heard) = (0, 0);
        for (tick, frame) in sent.iter().enumerate() {
            if tick % 7 == 3 {
                continue;
            }
            let Heard { message, lost: missing } = decoder.take(frame).expect("sound");
            let Some(Message::EgoState(ego)) = message else { panic!("{message:?}") };
            assert_eq!(ego.tick as usize, tick);
            (lost, heard) = (lost + missing, heard + 1);
        }
        assert_eq!((sent.len(), heard, lost), (300, 257, 43));
    }

    #[test]
    fn repeated_damaged_short_and_foreign_frames_have_no_effect() {
        let sent = frames(&mut Encoder::default(), 0..1);
        let mut decoder = Decoder::default();
        assert!(decoder.take(&sent[0]).is_ok());
        assert_eq!(decoder.take(&sent[0]), Err(Refusal::Repeated));
        let flags = sent[0].flags();
        let mut data = sent[0].data().to_vec();
        data[9] ^= 0x10;
        let rebuilt = |id, data: &[u8]| Frame::new(id, flags, data).expect("a frame");
        assert_eq!(decoder.take(&rebuilt(EgoState::ID, &data)), Err(Refusal::Crc));
        assert_eq!(decoder.take(&rebuilt(EgoState::ID, &data[..16])), Err(Refusal::Malformed));
        assert_eq!(decoder.take(&rebuilt(0x123, &data)), Err(Refusal::UnknownId));
    }

    #[test]
    fn an_encode_error_emits_nothing_and_costs_no_counter() {
        let mut encoder = Encoder::default();
        let broken = EgoState { heading_rad: f64::NAN, ..EgoState::default() };
        let refused = encoder.encode(&Message::EgoState(broken), &mut |_| panic!("emitted"));
        assert_eq!(refused, Err(EncodeError::NotANumber("Heading")));
        assert_eq!(encoder, Encoder::default());
    }
}
