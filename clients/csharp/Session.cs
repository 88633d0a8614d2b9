// A client of `haptix serve` for Unity, Mono and .NET. See README.md.
namespace Haptix
{
    using System;
    using System.Collections.Concurrent;
    using System.Collections.Generic;
    using System.Threading;
    using System.Threading.Tasks;
    using Haptix.Messages;
    using Newtonsoft.Json.Linq;

    /// <summary>The connection broke, and is tried again.</summary>
    public sealed class Disconnected { public string Reason; }

    /// <summary>The connection is there again, disarmed; the lease too where it was kept.</summary>
    public sealed class Resumed { public Welcome Welcome; }

    /// <summary>Nothing more comes.</summary>
    public sealed class Closed { public string Reason; }

    /// <summary>
    /// A session with the service. A thread of its own answers the service's pings, so a scene that
    /// loads for long stays alive; handlers are called by `Pump`, in the thread that calls it.
    /// </summary>
    public sealed partial class Session : IDisposable
    {
        const string Protocol = "1.0";
        const string Empty = "{'inventory': {'devices': [{}]}, 'limits': {}, 'keep_alive': {}, 'output': {}, 'lease': {}}";
        const double WaitS = 10.0, CloseS = 1.0;
        const double FirstS = 0.1, LastS = 5.0; // between two attempts to connect again
        const int MostEvents = 1000; // that wait for `Pump`; then the oldest are dropped
        static readonly Dictionary<string, Type> Types = new Dictionary<string, Type>
        {
            { "lease", typeof(Lease) }, { "output", typeof(Output) }, { "inventory", typeof(Inventory) },
            { "contact", typeof(Contact) }, { "effect_ended", typeof(EffectEnded) },
            { "job", typeof(Job) }, { "warning", typeof(Warning) }, { "error", typeof(Error) }, { "bye", typeof(Bye) },
        };

        readonly string _name;
        readonly Func<Service> _find;
        readonly object _gate = new object();
        readonly Dictionary<long, TaskCompletionSource<JObject>> _asked =
            new Dictionary<long, TaskCompletionSource<JObject>>();
        readonly ConcurrentQueue<object> _events = new ConcurrentQueue<object>();
        readonly Dictionary<Type, List<Action<object>>> _handlers = new Dictionary<Type, List<Action<object>>>();
        readonly TaskCompletionSource<Session> _opened = NewSource<Session>();
        readonly ManualResetEventSlim _closing = new ManualResetEventSlim();
        readonly Thread _thread;
        readonly Dictionary<string, double> _streams = new Dictionary<string, double>();
        readonly HashSet<string> _watched = new HashSet<string>(); // jobs
        Dictionary<string, string[]> _columns = new Dictionary<string, string[]>();
        Geometry _geometry;
        Link _link; // null while there is no connection
        volatile bool _isWelcome;
        double _silentS; // of the service; then the connection is given up
        long _id;
        uint _batch;

        Session(string name, Func<Service> find)
        {
            _name = name;
            _find = find;
            _thread = new Thread(Run) { IsBackground = true, Name = "haptix session" };
        }

        /// <summary>Open a session with the service of this machine, or with what `find` gives.</summary>
        public static Task<Session> Connect(string name, Func<Service> find = null)
        {
            var session = new Session(name, find ?? Service.Find);
            session._thread.Start();
            return session._opened.Task;
        }

        /// <summary>Clock that stamps touches.</summary>
        public static double NowS
        {
            get { return System.Diagnostics.Stopwatch.GetTimestamp() / (double)System.Diagnostics.Stopwatch.Frequency; }
        }

        /// <summary>What the service said at first; who holds the output and what it does, as last told.</summary>
        public Welcome Welcome { get; private set; }
        public Lease Lease { get; private set; }
        public Output Output { get; private set; }

        /// <summary>Call `handler` with each message, `Frame`, `Disconnected`, `Resumed` or `Closed`.</summary>
        public void On<T>(Action<T> handler)
        {
            List<Action<object>> handlers;
            if (!_handlers.TryGetValue(typeof(T), out handlers)) _handlers[typeof(T)] = handlers = new List<Action<object>>();
            handlers.Add(each => handler((T)each));
        }

        /// <summary>Call the handlers of what has come; once a frame, from the main thread.</summary>
        public void Pump()
        {
            object each;
            while (_events.TryDequeue(out each))
            {
                List<Action<object>> handlers;
                if (!_handlers.TryGetValue(each.GetType(), out handlers)) continue;
                foreach (Action<object> handler in handlers.ToArray()) handler(each);
            }
        }

        public Task<Lease> Acquire(bool takeover = false)
        {
            return Ask<Lease>(new Acquire { Type = "acquire", Takeover = takeover });
        }

        /// <summary>Give the lease back; 0 V first.</summary>
        public Task<Done> Release() { return Ask<Done>(new Plain { Type = "release" }); }

        /// <summary>Let touches be felt.</summary>
        public Task<Output> Arm() { return Ask<Output>(new Plain { Type = "arm" }); }

        /// <summary>End at 0 V and keep the lease.</summary>
        public Task<Output> Disarm() { return Ask<Output>(new Plain { Type = "disarm" }); }

        /// <summary>End at 0 V, whoever holds the output.</summary>
        public Task<Done> Stop() { return Ask<Done>(new Plain { Type = "stop" }); }

        /// <summary>Replace the layout by a document in JSON.</summary>
        public Task<LayoutReply> LayoutSet(string json)
        {
            return Ask<LayoutReply>(new JObject { { "type", "layout_set" }, { "document", JObject.Parse(json) } });
        }

        /// <summary>Change the layout by operations in JSON, `[{"op": "move", ...}]`: all, or nothing.</summary>
        public Task<LayoutReply> LayoutChange(string json)
        {
            return Ask<LayoutReply>(new JObject { { "type", "layout_change" }, { "ops", JArray.Parse(json) } });
        }

        /// <summary>Say how pixels become millimetres: origin + turn(rotation) (px / pxPerMm).</summary>
        public async Task<Done> Geometry(double pxPerMm, double xMm = 0, double yMm = 0, double rotationDeg = 0)
        {
            double[] origin = { xMm, yMm };
            var geometry = new Geometry { Type = "geometry", PxPerMm = pxPerMm, OriginMm = origin, RotationDeg = rotationDeg };
            Done done = await Ask<Done>(geometry).ConfigureAwait(false);
            _geometry = geometry;
            return done;
        }

        /// <summary>Play a transient effect, given in JSON; `EffectEnded` tells its end.</summary>
        public Task<Playing> Play(string json)
        {
            return Ask<Playing>(new JObject { { "type", "play" }, { "effect", JObject.Parse(json) } });
        }

        public Task<Done> Cancel(long effectId)
        {
            return Ask<Done>(new Cancel { Type = "cancel", EffectId = effectId });
        }

        /// <summary>Set the share of friction that is asked for, 0 to 1.</summary>
        public Task<Output> Intensity(double value)
        {
            return Ask<Output>(new Intensity { Type = "intensity", Value = value });
        }

        /// <summary>Hold 0 V while time runs.</summary>
        public Task<Output> Mute(bool on) { return Ask<Output>(new Switch { Type = "mute", On = on }); }

        /// <summary>Hold 0 V while time stands.</summary>
        public Task<Output> Pause(bool on) { return Ask<Output>(new Switch { Type = "pause", On = on }); }

        public Task<Inventory> Inventory() { return Ask<Inventory>(new Plain { Type = "inventory" }); }

        /// <summary>Return how far a job is; `Job` tells its changes until it ends, and how far it is after a lost connection.</summary>
        public async Task<Job> Watch(string job)
        {
            Job found = await Ask<Job>(new Watch { Type = "watch", Job = job }).ConfigureAwait(false);
            lock (_gate) _watched.Add(job);
            return found;
        }

        /// <summary>Ask for a stream of `Frame` at a rate; 0 ends it.</summary>
        public async Task<Subscribed> Subscribe(string stream, double rateHz)
        {
            var streams = new Dictionary<string, double> { { stream, rateHz } };
            Subscribed found = await Ask<Subscribed>(new Subscribe { Type = "subscribe", Streams = streams }).ConfigureAwait(false);
            lock (_gate) _streams[stream] = rateHz;
            return found;
        }

        /// <summary>Report a touch, now unless it says when; false where there is no connection.</summary>
        public bool Touch(float xMm, float yMm, float? normalForceN = null, int touchId = 0,
            TouchKind kind = TouchKind.Move, double? timeS = null)
        {
            return Touches(new[] { new TouchReport {
                TimeS = timeS ?? NowS, X = xMm, Y = yMm, NormalForceN = normalForceN, TouchId = touchId, Kind = kind } });
        }

        /// <summary>Take a finger off.</summary>
        public bool Lift(int touchId = 0) { return Touch(0f, 0f, null, touchId, TouchKind.Up); }

        /// <summary>Report many touches in one batch of bytes, at most `Welcome.Limits.BatchTouches`.</summary>
        public bool Touches(IList<TouchReport> touches)
        {
            lock (_gate)
            {
                if (_link == null || !_isWelcome) return false;
                _link.Send(Batches.Write(touches, ++_batch), false);
                return true;
            }
        }

        /// <summary>Send a message and return its answer; throws `Refused` or `Lost`.</summary>
        public async Task<T> Ask<T>(object message)
        {
            TaskCompletionSource<JObject> answer = NewSource<JObject>();
            JObject json = JObject.FromObject(message);
            string type = (string)json["type"];
            long id;
            lock (_gate) // ids leave in their order
            {
                if (_link == null) throw new Lost(type + ": the connection is gone");
                json["id"] = id = ++_id;
                _asked[id] = answer;
                _link.Send(json);
            }
            using (var ends = new CancellationTokenSource())
            {
                Task late = Task.Delay(TimeSpan.FromSeconds(WaitS), ends.Token);
                if (await Task.WhenAny(answer.Task, late).ConfigureAwait(false) == late)
                {
                    lock (_gate) _asked.Remove(id);
                    throw new Lost(type + ": no answer within " + WaitS + " s");
                }
                ends.Cancel();
            }
            return (await answer.Task.ConfigureAwait(false)).ToObject<T>();
        }

        /// <summary>Leave: 0 V first, and the lease is free for others. Takes a second at most.</summary>
        public void Dispose()
        {
            if (_closing.IsSet) return;
            _closing.Set();
            Task leaving = Leave();
            Task.WhenAny(leaving, Task.Delay(TimeSpan.FromSeconds(CloseS))).Wait();
            lock (_gate) if (_link != null) _link.Dispose();
            if (Thread.CurrentThread != _thread) _thread.Join(TimeSpan.FromSeconds(CloseS));
        }

        async Task Leave()
        {
            try
            {
                if (Lease != null && Lease.IsMine) await Release().ConfigureAwait(false);
                await Ask<Done>(new Plain { Type = "bye" }).ConfigureAwait(false);
            }
            catch (Exception) { } // it is gone already, and with it the voltage
        }
    }
}
