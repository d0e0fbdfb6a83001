//! The words of Foxglove's WebSocket protocol that a server without requests needs, see
//! <https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md>.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::Deserialize;
use serde_json::json;
use traces::Offer;

/// Names under which the same words are spoken, ours first.
pub const PROTOCOLS: [&str; 2] = ["foxglove.websocket.v1", "foxglove.sdk.v1"];
/// Opcode of a message on a subscribed channel.
const MESSAGE_DATA: u8 = 1;

/// What guests say that matters here.
#[derive(Debug, Deserialize, PartialEq, Eq)]
#[serde(tag = "op", rename_all = "camelCase")]
pub enum Request {
    /// Send these channels.
    Subscribe {
        /// Each with the guest's own number for it.
        subscriptions: Vec<Subscription>,
    },
    /// Send them no longer.
    Unsubscribe {
        /// The guest's own numbers.
        #[serde(rename = "subscriptionIds")]
        subscription_ids: Vec<u32>,
    },
}

/// A guest's wish for a channel.
#[derive(Debug, Clone, Copy, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "camelCase")]
pub struct Subscription {
    /// The guest's number for it.
    pub id: u32,
    /// The channel.
    pub channel_id: u32,
}

/// What a guest is told first.
pub fn server_info(title: &str) -> String {
    json!({
        "op": "serverInfo",
        "name": title,
        "capabilities": [],
        "supportedEncodings": [],
        "metadata": { "platoon": env!("CARGO_PKG_VERSION") },
    })
    .to_string()
}

/// Announces channels, numbered from `first` on.
pub fn advertise(offers: &[Offer], first: u32) -> String {
    let channels = offers.iter().zip(first..).map(|(offer, id)| {
        // Binary schemas travel as base64, texts as they are.
        let schema = match offer.schema_encoding {
            "protobuf" => STANDARD.encode(&offer.schema),
            _ => String::from_utf8_lossy(&offer.schema).into_owned(),
        };
        json!({
            "id": id,
            "topic": offer.topic,
            "encoding": offer.encoding,
            "schemaName": offer.schema_name,
            "schemaEncoding": offer.schema_encoding,
            "schema": schema,
        })
    });
    json!({ "op": "advertise", "channels": channels.collect::<Vec<_>>() }).to_string()
}

/// A message on a subscribed channel.
pub fn message_data(subscription: u32, log_time_ns: u64, data: &[u8]) -> Vec<u8> {
    let mut parcel = Vec::with_capacity(13 + data.len());
    parcel.push(MESSAGE_DATA);
    parcel.extend(subscription.to_le_bytes());
    parcel.extend(log_time_ns.to_le_bytes());
    parcel.extend(data);
    parcel
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_understood_and_others_are_not_ours() {
        let parse = |text| serde_json::from_str::<Request>(text).ok();
        let wish = Subscription { id: 7, channel_id: 3 };
        assert_eq!(
            parse(r#"{"op":"subscribe","subscriptions":[{"id":7,"channelId":3}]}"#),
            Some(Request::Subscribe { subscriptions: vec![wish] })
        );
        assert_eq!(
            parse(r#"{"op":"unsubscribe","subscriptionIds":[7]}"#),
            Some(Request::Unsubscribe { subscription_ids: vec![7] })
        );
        assert_eq!(parse(r#"{"op":"setParameters","parameters":[]}"#), None);
        assert_eq!(parse("nonsense"), None);
    }

    #[test]
    fn a_message_has_its_subscription_and_time_before_it() {
        let parcel = message_data(0x0403_0201, 5, b"xy");
        assert_eq!(parcel, [1, 1, 2, 3, 4, 5, 0, 0, 0, 0, 0, 0, 0, b'x', b'y']);
    }
}
