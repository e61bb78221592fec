//! The web view: one page, served by this program and needing nothing else.
//!
//! In: the shared model. Out: HTTP on one thread: the page with its scripts, and for each browser
//! a stream of server-sent events, four a second, each made when that browser is ready for it. So
//! a slow browser gets fewer, and holds up nobody.
//!
//! The page is read-only. Its headers let it load what this program serves and nothing else. Only
//! requests that name this machine by its address are answered, so that no other site can lead a
//! browser here under a name of its own.
//!
//! Left out: who may look, which an address other than the loopback leaves to the network; TLS.

mod update;

use std::convert::Infallible;
use std::future::Future;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::extract::Path;
use axum::http::{HeaderMap, HeaderName, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use futures_core::Stream;
use tokio::sync::oneshot;
use tokio::time::{Interval, MissedTickBehavior};

use super::reading::Shared;
use update::Cursor;

/// From one message to the next.
const TICK: Duration = Duration::from_millis(250);

/// Browsers that are served at the same time.
const MOST_BROWSERS: usize = 16;

/// What may be loaded: what comes from here.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; \
    connect-src 'self'; img-src 'self' data:; base-uri 'none'; form-action 'none'; \
    frame-ancestors 'none'";

const HTML: &str = "text/html; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const STYLE: &str = "text/css; charset=utf-8";
const JSON: &str = "application/json";

/// The parts of the page: path, kind, content.
const PARTS: [(&str, &str, &str); 8] = [
    ("/", HTML, include_str!("page.html")),
    ("/base.css", STYLE, output::html::BASE),
    ("/page.css", STYLE, include_str!("page.css")),
    ("/page.js", SCRIPT, include_str!("page.js")),
    ("/charts.js", SCRIPT, include_str!("charts.js")),
    ("/attitude.js", SCRIPT, include_str!("attitude.js")),
    ("/uplot.js", SCRIPT, include_str!("uplot.min.js")),
    ("/uplot.css", STYLE, include_str!("uplot.min.css")),
];

/// The licence of the charts' library, which goes with it.
const LICENCE: &str = include_str!("uplot-LICENSE.txt");

/// The server; it ends when this is dropped.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Serves a model to who comes to a bound listener.
    ///
    /// Errors: what the system reports.
    pub fn start(listener: std::net::TcpListener, shared: Arc<Shared>) -> io::Result<Self> {
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_io()
            .enable_time()
            .build()?;
        let (stop, stopped) = oneshot::channel();
        let thread = thread::Builder::new().name("web".to_owned());
        let thread = thread.spawn(move || {
            // Streams never end by themselves, so they are dropped with the runtime.
            runtime.block_on(serve(listener, shared, stopped));
        })?;
        Ok(Self {
            address,
            stop: Some(stop),
            thread: Some(thread),
        })
    }

    /// What to type into a browser.
    pub fn url(&self) -> String {
        format!("http://{}/", self.address)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

async fn serve(
    listener: std::net::TcpListener,
    shared: Arc<Shared>,
    stopped: oneshot::Receiver<()>,
) {
    let Ok(listener) = tokio::net::TcpListener::from_std(listener) else {
        return;
    };
    let mut server = Box::pin(axum::serve(listener, router(shared)).into_future());
    let mut stopped = stopped;
    std::future::poll_fn(|context| {
        if Pin::new(&mut stopped).poll(context).is_ready() {
            return Poll::Ready(());
        }
        server.as_mut().poll(context).map(drop)
    })
    .await;
}

fn router(shared: Arc<Shared>) -> Router {
    let mut router = Router::new();
    for (path, kind, content) in PARTS {
        let part = move |headers: HeaderMap| async move { answer(&headers, kind, content) };
        router = router.route(path, get(part));
    }
    let licence =
        |headers: HeaderMap| async move { answer(&headers, "text/plain; charset=utf-8", LICENCE) };
    let browsers = Arc::new(AtomicUsize::new(0));
    let streamed = Arc::clone(&shared);
    let stream = move |headers: HeaderMap| {
        let answer = events(&headers, &streamed, &browsers);
        async move { answer }
    };
    let trace = move |Path((span_s, instrument)): Path<(u64, usize)>, headers: HeaderMap| {
        let answer = trace(&headers, &shared, span_s, instrument);
        async move { answer }
    };
    router
        .route("/licence", get(licence))
        .route("/events", get(stream))
        .route("/trace/{span_s}/{instrument}", get(trace))
}

/// Headers of every answer.
fn headers(kind: &'static str) -> [(HeaderName, &'static str); 5] {
    [
        (header::CONTENT_TYPE, kind),
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-store"),
    ]
}

fn answer(asked: &HeaderMap, kind: &'static str, content: impl Into<Body>) -> Response {
    if !names_an_address(asked) {
        let sentence = "call this page by the address of its machine, not by a name\n";
        return (StatusCode::FORBIDDEN, headers("text/plain"), sentence).into_response();
    }
    (headers(kind), content.into()).into_response()
}

/// Whether the request was made to an address or to `localhost`. A name may be somebody else's,
/// who leads it here to read what the page shows.
fn names_an_address(asked: &HeaderMap) -> bool {
    let host = asked.get(header::HOST).and_then(|host| host.to_str().ok());
    let Some(host) = host else {
        return false;
    };
    if host.parse::<SocketAddr>().is_ok() {
        return true;
    }
    let name = host.rsplit_once(':').map_or(host, |(name, _)| name);
    let bare = name.trim_start_matches('[').trim_end_matches(']');
    name == "localhost" || bare.parse::<IpAddr>().is_ok()
}

fn trace(asked: &HeaderMap, shared: &Shared, span_s: u64, instrument: usize) -> Response {
    let trace = {
        let model = shared.model();
        update::trace(&model, instrument.wrapping_sub(1), span_s)
    };
    match serde_json::to_string(&trace) {
        Ok(text) => answer(asked, JSON, text),
        Err(_) => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    }
}

fn events(asked: &HeaderMap, shared: &Arc<Shared>, browsers: &Arc<AtomicUsize>) -> Response {
    let seat = Seat::take(browsers);
    let Some(seat) = seat else {
        let sentence = "16 browsers look at this page already\n";
        return (StatusCode::SERVICE_UNAVAILABLE, sentence).into_response();
    };
    let mut ticks = tokio::time::interval(TICK);
    // Who was slow begins anew from now and gets nothing twice.
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let messages = Messages {
        shared: Arc::clone(shared),
        cursor: Cursor::default(),
        ticks,
        _seat: seat,
    };
    answer(asked, "text/event-stream", Body::from_stream(messages))
}

/// One browser's place.
struct Seat(Arc<AtomicUsize>);

impl Seat {
    fn take(browsers: &Arc<AtomicUsize>) -> Option<Self> {
        let before = browsers.fetch_add(1, Ordering::Relaxed);
        // Given back at once where there was none.
        let seat = Self(Arc::clone(browsers));
        (before < MOST_BROWSERS).then_some(seat)
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

/// What one browser gets, message by message.
struct Messages {
    shared: Arc<Shared>,
    cursor: Cursor,
    ticks: Interval,
    _seat: Seat,
}

impl Stream for Messages {
    type Item = Result<String, Infallible>;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        if self.ticks.poll_tick(context).is_pending() {
            return Poll::Pending;
        }
        let shared = Arc::clone(&self.shared);
        let update = {
            let model = shared.model();
            self.cursor.next(&model)
        };
        // A message of whole numbers and finite ones always has a form in JSON.
        let Ok(text) = serde_json::to_string(&update) else {
            return Poll::Ready(None);
        };
        Poll::Ready(Some(Ok(format!("data: {text}\n\n"))))
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::{Model, Setup};
    use super::*;
    use canopen::Frame;
    use listen::Plan;
    use std::io::{BufRead, BufReader, Read, Write};
    use std::net::TcpStream;

    fn server() -> (Server, Arc<Shared>) {
        let model = Model::new(&Plan::default(), Setup::default());
        let shared = Arc::new(Shared::new(model));
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let server = Server::start(listener, Arc::clone(&shared)).unwrap();
        (server, shared)
    }

    fn ask(server: &Server, path: &str, host: &str) -> TcpStream {
        let mut stream = TcpStream::connect(server.address).unwrap();
        let time = Some(Duration::from_secs(60));
        stream.set_read_timeout(time).unwrap();
        write!(
            stream,
            "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"
        )
        .unwrap();
        stream
    }

    fn whole(server: &Server, path: &str, host: &str) -> String {
        let mut text = String::new();
        ask(server, path, host).read_to_string(&mut text).unwrap();
        text
    }

    /// The next message of a stream.
    fn message(lines: &mut impl BufRead) -> serde_json::Value {
        loop {
            let mut line = String::new();
            assert_ne!(
                lines.read_line(&mut line).unwrap(),
                0,
                "the stream has ended"
            );
            if let Some(text) = line.strip_prefix("data: ") {
                return serde_json::from_str(text).unwrap();
            }
        }
    }

    #[test]
    fn every_part_comes_with_headers_that_let_nothing_else_in() {
        let (server, _) = server();
        for (path, kind, content) in PARTS {
            let text = whole(&server, path, "127.0.0.1:8410");
            assert!(text.starts_with("HTTP/1.1 200 OK\r\n"), "{path}");
            assert!(
                text.contains(&format!("content-type: {kind}\r\n")),
                "{path}"
            );
            let policy = "content-security-policy: default-src 'none'; script-src 'self';";
            assert!(text.contains(policy), "{path}");
            assert!(text.ends_with(content), "{path}");
        }
        assert!(whole(&server, "/licence", "localhost").contains("MIT License"));
        assert!(whole(&server, "/nothing", "localhost").starts_with("HTTP/1.1 404"));
    }

    #[test]
    fn the_page_names_no_other_place() {
        for (path, _, content) in PARTS {
            // The library names its own home in a comment.
            let own = content
                .lines()
                .skip(usize::from(path.starts_with("/uplot")));
            let found: Vec<_> = own.filter(|line| line.contains("://")).collect();
            assert!(found.is_empty(), "{path}: {found:?}");
        }
        let html = PARTS[0].2;
        assert!(!html.contains("<style") && !html.contains(" style=") && !html.contains("onclick"));
    }

    #[test]
    fn a_name_of_somebody_else_is_refused() {
        let (server, _) = server();
        for host in [
            "127.0.0.1:1",
            "localhost:8410",
            "localhost",
            "[::1]:8410",
            "10.0.0.5",
        ] {
            assert!(
                whole(&server, "/", host).starts_with("HTTP/1.1 200"),
                "{host}"
            );
        }
        for host in [
            "evil.example",
            "evil.example:8410",
            "localhost.evil.example",
            "",
        ] {
            let text = whole(&server, "/", host);
            assert!(text.starts_with("HTTP/1.1 403"), "{host}: {text}");
        }
    }

    #[test]
    fn a_browser_gets_state_events_and_trace_and_then_only_what_is_new() {
        let (server, shared) = server();
        let start = 1_700_000_000_000_000_000;
        for cycle in 0..10 {
            let at = start + cycle * 200_000_000;
            let mut model = shared.model();
            model.take(at, &Frame::data_frame(0x80, &[]));
            model.take(at, &Frame::data_frame(0x181, &[10, 0, 20, 0, 0x7F, 1]));
        }
        let mut lines = BufReader::new(ask(&server, "/events", "localhost"));
        let first = message(&mut lines);
        let channel = &first["state"]["instruments"][0]["channels"][0];
        assert_eq!(channel["slope_x_deg"], 0.1);
        assert_eq!(first["events"][0]["text"], "both agree");
        let points = first["traces"][0]["points"].as_array().unwrap();
        // The bucket of now is not whole yet.
        assert_eq!(points.len(), 9);
        assert_eq!(points[0][1], 0.1);
        assert_eq!(points[0][3], 0.2);
        assert!(points[0][5].is_null());
        let second = message(&mut lines);
        assert!(second["events"].as_array().unwrap().is_empty());
        assert!(second["traces"][0]["points"].as_array().unwrap().is_empty());
        let text = whole(&server, "/trace/600/1", "localhost");
        assert!(text.contains("\"width_s\":1.0"), "{text}");
        assert!(whole(&server, "/trace/600/9", "localhost").contains("\"points\":[]"));
    }

    #[test]
    fn a_browser_that_does_not_read_holds_up_nobody() {
        let (server, shared) = server();
        let _deaf: Vec<_> = (0..4)
            .map(|_| ask(&server, "/events", "localhost"))
            .collect();
        let mut lines = BufReader::new(ask(&server, "/events", "localhost"));
        for count in 0..200_000_u64 {
            let frame = Frame::data_frame(0x181, &[10, 0, 20, 0, 0x7F, 1]);
            shared.model().take(count * 1_000_000, &frame);
        }
        loop {
            if message(&mut lines)["state"]["bus"]["frames"] == 200_000 {
                break;
            }
        }
    }

    #[test]
    fn there_is_room_for_so_many_browsers_and_a_place_is_given_back() {
        let (server, _) = server();
        let open = || {
            let mut lines = BufReader::new(ask(&server, "/events", "localhost"));
            let mut line = String::new();
            lines.read_line(&mut line).unwrap();
            (line, lines)
        };
        let mut seats: Vec<_> = (0..MOST_BROWSERS).map(|_| open()).collect();
        assert!(seats.iter().all(|(line, _)| line.contains("200")));
        assert!(open().0.contains("503"));
        seats.clear();
        // The server finds out at its next message.
        for _ in 0..100 {
            if open().0.contains("200") {
                return;
            }
            thread::sleep(TICK);
        }
        panic!("no place was given back");
    }

    #[test]
    fn the_end_closes_every_stream() {
        let (server, _) = server();
        let mut lines = BufReader::new(ask(&server, "/events", "localhost"));
        message(&mut lines);
        drop(server);
        let mut rest = String::new();
        // Closed or reset: either way the browser has the end.
        let _ = lines.read_to_string(&mut rest);
    }
}
