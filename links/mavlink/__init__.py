"""MAVLink without I/O: bytes in, batches of samples out, and messages as bytes.

::

    decoder = Decoder(DecoderOptions(dialect="ardupilotmega"))
    batch = decoder.feed(datagram)          # rows per sensor, what was rejected and why
    decoder.counters, decoder.vehicle       # what went through, and whose it is

    encoder = Encoder(system_id=1, component_id=191)
    link.send(encoder.encode("STATUSTEXT", severity=4, text="airspeed0 FAULTY: 3.1 m/s low"))
"""

from links.mavlink.decode import Decoder
from links.mavlink.encoder import OUTPUT_MESSAGES, Encoder, encode
from links.mavlink.options import DecoderOptions, Vehicle
from links.mavlink.traffic import Counters

__all__ = [
    "OUTPUT_MESSAGES",
    "Counters",
    "Decoder",
    "DecoderOptions",
    "Encoder",
    "Vehicle",
    "encode",
]
