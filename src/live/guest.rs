//! One guest of the live view.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

use futures_util::{SinkExt, StreamExt};
use tokio::net::TcpStream;
use tokio::sync::mpsc;
use tokio_tungstenite::tungstenite::Message as Parcel;
use tokio_tungstenite::tungstenite::handshake::server::{ErrorResponse, Request, Response};
use tokio_tungstenite::tungstenite::http::{HeaderValue, StatusCode};

use super::Hall;
use super::words::{self, PROTOCOLS};

/// Parcels that wait for a guest; about half a second of everything.
const WAITING_MAX: usize = 8192;
/// Header by which protocols are asked for and chosen.
const PROTOCOL_HEADER: &str = "sec-websocket-protocol";

/// A guest as the hall knows it.
pub struct Guest {
    waiting: mpsc::Sender<Parcel>,
    /// The guest's own number for each channel it wants.
    subscriptions: RefCell<BTreeMap<u32, u32>>,
}

impl Guest {
    /// Puts a parcel into the guest's queue; false when that is full.
    pub fn offer(&self, parcel: Parcel) -> bool {
        self.waiting.try_send(parcel).is_ok()
    }

    /// The guest's own number for a channel, if it wants it.
    pub fn subscription(&self, channel: u32) -> Option<u32> {
        self.subscriptions.borrow().get(&channel).copied()
    }

    /// Does what the guest asks for; what is no request of ours is passed over.
    fn heed(&self, text: &str) {
        let mut wanted = self.subscriptions.borrow_mut();
        match serde_json::from_str(text) {
            Ok(words::Request::Subscribe { subscriptions }) => {
                wanted.extend(subscriptions.iter().map(|wish| (wish.channel_id, wish.id)));
            }
            Ok(words::Request::Unsubscribe { subscription_ids }) => {
                wanted.retain(|_, id| !subscription_ids.contains(id));
            }
            Err(_) => {}
        }
    }
}

/// Agrees on a protocol that both speak.
#[expect(clippy::result_large_err, reason = "the signature is the library's")]
fn agree(request: &Request, mut response: Response) -> Result<Response, ErrorResponse> {
    let asked = request.headers().get_all(PROTOCOL_HEADER).iter();
    let asked = asked.filter_map(|value| value.to_str().ok()).flat_map(|list| list.split(','));
    let asked: Vec<&str> = asked.map(str::trim).collect();
    match PROTOCOLS.iter().find(|protocol| asked.contains(protocol)) {
        Some(protocol) => {
            response.headers_mut().insert(PROTOCOL_HEADER, HeaderValue::from_static(protocol));
            Ok(response)
        }
        None => {
            let words = format!("this server speaks {}", PROTOCOLS.join(" and "));
            let mut refusal = ErrorResponse::new(Some(words));
            *refusal.status_mut() = StatusCode::BAD_REQUEST;
            Err(refusal)
        }
    }
}

/// Serves a guest until it leaves.
pub async fn serve(stream: TcpStream, hall: &Hall) {
    let Ok(socket) = tokio_tungstenite::accept_hdr_async(stream, agree).await else { return };
    let (mut to_guest, mut from_guest) = socket.split();
    let (waiting, mut queue) = mpsc::channel(WAITING_MAX);
    let guest = Rc::new(Guest { waiting, subscriptions: RefCell::default() });
    let welcome = [words::server_info(&hall.title), words::advertise(&hall.offers.borrow(), 1)];
    for text in welcome {
        guest.offer(Parcel::text(text));
    }
    hall.guests.borrow_mut().push(Rc::clone(&guest));
    hall.came.set(hall.came.get() + 1);
    loop {
        tokio::select! {
            heard = from_guest.next() => match heard {
                Some(Ok(Parcel::Text(text))) => guest.heed(text.as_str()),
                Some(Ok(Parcel::Close(_)) | Err(_)) | None => break,
                Some(Ok(_)) => {}
            },
            parcel = queue.recv() => {
                let Some(parcel) = parcel else { break };
                if to_guest.send(parcel).await.is_err() {
                    break;
                }
            }
        }
    }
    hall.guests.borrow_mut().retain(|other| !Rc::ptr_eq(other, &guest));
}
