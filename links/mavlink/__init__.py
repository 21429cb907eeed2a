"""MAVLink without I/O: bytes in, batches of samples out, and messages as bytes.

::

    decoder = Decoder(DecoderOptions(dialect="ardupilotmega"))
    batch = decoder.feed(datagram)          # rows per sensor, what was rejected and why
    decoder.counters, decoder.vehicle       # what went through, and whose it is
"""

from links.mavlink.decode import Counters, Decoder, DecoderOptions, Vehicle

__all__ = ["Counters", "Decoder", "DecoderOptions", "Vehicle"]
