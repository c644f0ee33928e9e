// Reads NMEA from a local TCP port with Signal K's parser: node boat.js PORT HEADING_DEG BOUND_DEG.
// Exit code 0 after twenty correct magnetic headings of both sentences, 1 at the first wrong one.

const net = require('net')
const readline = require('readline')
// scripts/peers installs the package.
const Parser = require(require.resolve('@signalk/nmea0183-signalk', { paths: [process.env.NODE_PEERS] }))

const [port, headingDeg, boundDeg] = process.argv.slice(2).map(Number)
const parser = new Parser()
const counts = { HDM: 0, HDG: 0 }
const socket = net.connect(port, '127.0.0.1')

function fail (why) {
  console.error(why)
  process.exit(1)
}

readline.createInterface({ input: socket }).on('line', (line) => {
  const kind = line.slice(3, 6)
  // The first line may be incomplete; Signal K ignores proprietary sentences.
  if (!line.startsWith('$HC') || !(kind in counts)) return
  // Empty until the module has an attitude.
  if (line.split(',')[1] === '') return
  const delta = parser.parse(line)
  if (!delta) fail(`not understood: ${line}`)
  const values = delta.updates[0].values.filter(({ path }) => path === 'navigation.headingMagnetic')
  if (values.length !== 1) fail(`no magnetic heading: ${line}`)
  const offDeg = ((values[0].value * 180 / Math.PI - headingDeg + 540) % 360) - 180
  if (!(Math.abs(offDeg) < boundDeg)) fail(`${line}: ${offDeg} deg off`)
  counts[kind] += 1
  if (counts.HDM >= 20 && counts.HDG >= 20) {
    console.log(`Signal K: ${JSON.stringify(counts)}`)
    process.exit(0)
  }
})
socket.on('close', () => fail('the module has gone'))
