"""Bounded connections on the loopback: sockets, HTTP, XML-RPC, TCPROS headers. tasks.ros.graph imports it."""
