// One WebSocket: sends from a thread of its own, so that who reports a touch never waits.
namespace Haptix
{
    using System;
    using System.Collections.Concurrent;
    using System.Collections.Generic;
    using System.Globalization;
    using System.IO;
    using System.Net.Security;
    using System.Net.Sockets;
    using System.Net.WebSockets;
    using System.Security.Cryptography;
    using System.Text;
    using System.Threading;
    using Newtonsoft.Json;
    using Newtonsoft.Json.Linq;

    sealed class Link : IDisposable
    {
        const string Subprotocol = "haptix.v1";
        const int BufferBytes = 16384, MostHeader = 8192;
        static readonly TimeSpan ConnectTime = TimeSpan.FromSeconds(5);

        const int MostAtOnce = 64, MostWaiting = 1000; // batches of touches

        struct Message { public byte[] Bytes; public bool IsText; public long Ping; }

        /// <summary>As many of something as a rate lets pass, and some at once.</summary>
        sealed class Limiter
        {
            readonly double _rate, _most;
            double _free, _atS = Session.NowS;

            public Limiter(double rate, double most) { _rate = rate; _free = _most = most; }

            /// <summary>Take some, and return how long to wait before the next.</summary>
            public double Take(int count)
            {
                double atS = Session.NowS;
                _free = Math.Min(_most, _free + (atS - _atS) * _rate) - count;
                _atS = atS;
                return Math.Max(0, -_free / _rate);
            }
        }

        readonly WebSocket _socket;
        readonly TcpClient _tcp;
        readonly BlockingCollection<Message> _outbox = new BlockingCollection<Message>();
        readonly Queue<KeyValuePair<byte[], int>> _waiting = new Queue<KeyValuePair<byte[], int>>();
        Limiter _batches, _touches;
        double _nextS; // when touches may be sent again
        readonly CancellationTokenSource _ends = new CancellationTokenSource();
        readonly byte[] _part = new byte[65536];

        Link(WebSocket socket, TcpClient tcp)
        {
            _socket = socket;
            _tcp = tcp;
            IsOpen = true;
            Reason = "it closed";
            new Thread(Sends) { IsBackground = true, Name = "haptix sender" }.Start();
        }

        public bool IsOpen { get; private set; }
        public string Reason { get; private set; }
        public int CloseCode { get; private set; }

        /// <summary>
        /// Connect. `ClientWebSocket` leaves Nagle's algorithm on, which holds a touch back until the
        /// one before is acknowledged, 40 ms later; so the handshake is ours (RFC 6455, section 4.1).
        /// </summary>
        public static Link Open(string url)
        {
            var uri = new Uri(url);
            var tcp = new TcpClient { NoDelay = true };
            try
            {
                if (!tcp.ConnectAsync(uri.Host, uri.Port).Wait(ConnectTime)) throw new IOException("no answer");
                tcp.ReceiveTimeout = (int)ConnectTime.TotalMilliseconds;
                Stream stream = tcp.GetStream();
                if (uri.Scheme == "wss")
                {
                    var secure = new SslStream(stream);
                    secure.AuthenticateAsClient(uri.Host);
                    stream = secure;
                }
                Upgrade(stream, uri);
                tcp.ReceiveTimeout = 0;
                WebSocket socket = WebSocket.CreateClientWebSocket(stream, Subprotocol, BufferBytes, BufferBytes,
                    Timeout.InfiniteTimeSpan, false, WebSocket.CreateClientBuffer(BufferBytes, BufferBytes));
                return new Link(socket, tcp);
            }
            catch (Lost)
            {
                tcp.Close();
                throw;
            }
            catch (Exception error)
            {
                tcp.Close();
                error = error is AggregateException ? error.InnerException : error;
                throw new Lost("no service answers at " + url + ": " + error.Message + "; start haptix serve");
            }
        }

        static void Upgrade(Stream stream, Uri uri)
        {
            string key = Convert.ToBase64String(Guid.NewGuid().ToByteArray());
            byte[] request = Encoding.ASCII.GetBytes(
                "GET " + uri.PathAndQuery + " HTTP/1.1\r\nHost: " + uri.Authority + "\r\nUpgrade: websocket\r\n"
                + "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: " + key
                + "\r\nSec-WebSocket-Protocol: " + Subprotocol + "\r\n\r\n");
            stream.Write(request, 0, request.Length);
            var answer = new StringBuilder();
            while (!answer.ToString().EndsWith("\r\n\r\n")) // no byte beyond it: frames follow
            {
                int next = stream.ReadByte();
                if (next < 0 || answer.Length > MostHeader) throw new IOException("it speaks no WebSocket");
                answer.Append((char)next);
            }
            string[] lines = answer.ToString().Split(new[] { "\r\n" }, StringSplitOptions.None);
            byte[] salted = Encoding.ASCII.GetBytes(key + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11");
            string accept;
            using (SHA1 sha = SHA1.Create()) accept = Convert.ToBase64String(sha.ComputeHash(salted));
            bool agrees = Array.Exists(lines, line =>
                line.StartsWith("Sec-WebSocket-Accept:", StringComparison.OrdinalIgnoreCase) && line.EndsWith(" " + accept));
            if (lines[0].StartsWith("HTTP/1.1 4")) throw new Lost("the service at " + uri + " refuses the connection: " + lines[0]);
            if (!lines[0].StartsWith("HTTP/1.1 101") || !agrees) throw new IOException(lines[0]);
        }

        public void Send(JObject message)
        {
            Send(Encoding.UTF8.GetBytes(message.ToString(Formatting.None)), true);
        }

        public void Send(byte[] bytes, bool isText)
        {
            if (!_outbox.IsAddingCompleted) _outbox.Add(new Message { Bytes = bytes, IsText = isText });
        }

        /// <summary>Send touches no faster than the service takes them, from now on.</summary>
        public void Limit(Messages.Limits limits)
        {
            lock (_waiting)
            {
                _touches = new Limiter(limits.TouchesPerS, limits.BatchTouches);
                _batches = new Limiter(limits.BatchesPerS, MostAtOnce);
            }
        }

        /// <summary>Send a batch of touches, or let it wait; return whether it could be. A finger's lift is never left out.</summary>
        public bool SendTouches(byte[] bytes, int count, bool lifts = false)
        {
            var batch = new KeyValuePair<byte[], int>(bytes, count);
            lock (_waiting)
            {
                if (_outbox.IsAddingCompleted || _waiting.Count >= MostWaiting && !lifts) return false;
                if (_waiting.Count == 0 && Session.NowS >= _nextS) Pass(batch);
                else _waiting.Enqueue(batch);
                if (_waiting.Count == 1) _outbox.Add(new Message()); // who sends must look at the time
                return true;
            }
        }

        void Pass(KeyValuePair<byte[], int> batch)
        {
            Send(batch.Key, false);
            if (_batches != null) _nextS = Session.NowS + Math.Max(_batches.Take(1), _touches.Take(batch.Value));
        }

        /// <summary>Answer a ping, by the clock of the moment when the answer leaves.</summary>
        public void Answer(long ping)
        {
            if (!_outbox.IsAddingCompleted) _outbox.Add(new Message { IsText = true, Ping = ping });
        }

        /// <summary>Return the next message; null once the connection is gone or silent for too long.</summary>
        public byte[] Receive(TimeSpan within, out bool isText)
        {
            isText = false;
            try
            {
                using (var late = CancellationTokenSource.CreateLinkedTokenSource(_ends.Token))
                using (var whole = new MemoryStream())
                {
                    late.CancelAfter(within);
                    while (true)
                    {
                        var part = new ArraySegment<byte>(_part);
                        WebSocketReceiveResult got = _socket.ReceiveAsync(part, late.Token).GetAwaiter().GetResult();
                        if (got.MessageType == WebSocketMessageType.Close)
                        {
                            CloseCode = (int)(got.CloseStatus ?? 0);
                            return Gone(CloseCode + " " + got.CloseStatusDescription);
                        }
                        whole.Write(_part, 0, got.Count);
                        isText = got.MessageType == WebSocketMessageType.Text;
                        if (got.EndOfMessage) return whole.ToArray();
                    }
                }
            }
            catch (OperationCanceledException) { return Gone("the service is silent"); }
            catch (Exception error) { return Gone(error.Message); }
        }

        byte[] Gone(string reason)
        {
            Reason = _ends.IsCancellationRequested ? "closed" : reason;
            IsOpen = false;
            return null;
        }

        void Sends()
        {
            try
            {
                while (!_outbox.IsCompleted)
                {
                    Message message;
                    int waitMs = Timeout.Infinite;
                    lock (_waiting)
                    {
                        bool isTime = Session.NowS >= _nextS;
                        if (_waiting.Count > 0 && isTime) Pass(_waiting.Dequeue());
                        else if (_waiting.Count > 0) waitMs = (int)Math.Ceiling((_nextS - Session.NowS) * 1e3);
                    }
                    if (!_outbox.TryTake(out message, Math.Max(waitMs, -1), _ends.Token)) continue;
                    if (message.IsText) Write(message.Bytes ?? Pong(message.Ping), true);
                    else if (message.Bytes != null) Write(message.Bytes, false);
                }
            }
            catch (Exception) { } // who receives hears of it too
        }

        void Write(byte[] bytes, bool isText)
        {
            var kind = isText ? WebSocketMessageType.Text : WebSocketMessageType.Binary;
            _socket.SendAsync(new ArraySegment<byte>(bytes), kind, true, _ends.Token).GetAwaiter().GetResult();
        }

        static byte[] Pong(long ping)
        {
            string clockS = Session.NowS.ToString("R", CultureInfo.InvariantCulture);
            return Encoding.UTF8.GetBytes("{\"type\":\"pong\",\"n\":" + ping + ",\"clock_s\":" + clockS + "}");
        }

        public void Dispose()
        {
            _outbox.CompleteAdding();
            _ends.Cancel();
            _socket.Dispose();
            _tcp.Close();
        }
    }
}
