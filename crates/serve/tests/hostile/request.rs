//! The text of requests.

use std::net::SocketAddr;

/// Writes requests to one address.
pub struct Requests {
    pub address: SocketAddr,
}

impl Requests {
    /// The head of a request that is the last one of its connection.
    pub fn head(&self, line: &str, headers: &[&str]) -> Vec<u8> {
        let mut head = format!(
            "{line} HTTP/1.1\r\nhost: {}\r\nconnection: close\r\n",
            self.address
        );
        for header in headers {
            head += header;
            head += "\r\n";
        }
        (head + "\r\n").into_bytes()
    }

    /// A request with a body.
    pub fn with_body(&self, line: &str, headers: &[&str], body: &[u8]) -> Vec<u8> {
        let length = format!("content-length: {}", body.len());
        let headers = [headers, &[&length]].concat();
        [self.head(line, &headers), body.to_vec()].concat()
    }

    pub fn locate(&self, content_type: &str, body: &[u8]) -> Vec<u8> {
        let content_type = format!("content-type: {content_type}");
        self.with_body("POST /v1/locate", &[&content_type], body)
    }
}
