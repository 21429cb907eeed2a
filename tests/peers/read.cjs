// Reads MAVLink frames with node-mavlink: node read.cjs FILE [PASSPHRASE], answers in JSON.
const { createReadStream } = require('node:fs')
const {
  MavLinkPacketSplitter, MavLinkPacketParser, MavLinkPacketSignature, minimal, common, ardupilotmega,
} = require('node-mavlink')

const [file, passphrase] = process.argv.slice(2)
const key = passphrase ? MavLinkPacketSignature.key(passphrase) : null
const registry = { ...minimal.REGISTRY, ...common.REGISTRY, ...ardupilotmega.REGISTRY }
const out = { packets: 0, bad: 0, unknown: 0, signed: 0, forged: 0, names: {}, values: [], texts: [] }

const splitter = new MavLinkPacketSplitter({}, { onCrcError: () => { out.bad += 1 } })
const parser = createReadStream(file).pipe(splitter).pipe(new MavLinkPacketParser())
parser.on('data', packet => {
  out.packets += 1
  if (packet.signature) {
    out.signed += 1
    if (!key || !packet.signature.matches(key)) out.forged += 1
  }
  const message = registry[packet.header.msgid]
  if (!message) {
    out.unknown += 1
    return
  }
  const data = packet.protocol.data(packet.payload, message)
  out.names[message.MSG_NAME] = (out.names[message.MSG_NAME] || 0) + 1
  if (message.MSG_NAME === 'NAMED_VALUE_FLOAT') out.values.push([data.name, data.value])
  if (message.MSG_NAME === 'STATUSTEXT') out.texts.push(data.text)
})
parser.on('end', () => console.log(JSON.stringify(out)))
