// A client of `haptix serve` for Unity, Mono and .NET. See README.md.
namespace Haptix
{
    using System;
    using System.Collections.Concurrent;
    using System.Collections.Generic;
    using System.Linq;
    using System.Threading;
    using System.Threading.Tasks;
    using Haptix.Messages;
    using Newtonsoft.Json;
    using Newtonsoft.Json.Linq;

    /// <summary>What Unity's stripping must keep: fields that are found by reflection alone.</summary>
    [AttributeUsage(AttributeTargets.All)]
    sealed class PreserveAttribute : Attribute { }

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
        // The service gives up what takes more than 20 s, and says so.
        const double WaitS = 25.0, CloseS = 1.0;
        const double FirstS = 0.1, LastS = 5.0; // between two attempts to connect again
        const int MostRefusals = 4; // of the token: a service that begins opens its port before it writes the new one
        const int MostEvents = 1000; // that wait for `Pump`; then frames of telemetry are dropped
        static readonly JsonSerializer Given = new JsonSerializer { NullValueHandling = NullValueHandling.Ignore };
        static readonly Dictionary<string, Type> Types = new Dictionary<string, Type>
        {
            { "lease", typeof(Lease) }, { "output", typeof(Output) }, { "inventory", typeof(Inventory) },
            { "contact", typeof(Contact) }, { "effect_ended", typeof(EffectEnded) },
            { "job", typeof(Job) }, { "warning", typeof(Warning) }, { "error", typeof(Error) }, { "bye", typeof(Bye) },
        };

        // IL2CPP compiles ahead of time, so it must see each collection of numbers that JSON becomes.
        internal static readonly object[] Kept = { new List<double>(), new Dictionary<string, double>() };

        readonly string _name, _app;
        readonly Dictionary<string, Contact> _on = new Dictionary<string, Contact>(); // the last of each finger and region
        readonly Func<Service> _find;
        readonly object _gate = new object();
        readonly Dictionary<long, TaskCompletionSource<JObject>> _asked =
            new Dictionary<long, TaskCompletionSource<JObject>>();
        readonly ConcurrentQueue<object> _events = new ConcurrentQueue<object>();
        readonly Dictionary<Type, List<Action<object>>> _handlers = new Dictionary<Type, List<Action<object>>>();
        readonly TaskCompletionSource<Session> _opened = NewSource<Session>();
        readonly ManualResetEventSlim _closing = new ManualResetEventSlim();
        readonly Thread _thread;
        readonly JObject _streams = new JObject();
        readonly HashSet<string> _watched = new HashSet<string>(); // jobs
        Dictionary<string, string[]> _columns = new Dictionary<string, string[]>();
        JObject _geometry;
        Link _link; // null while there is no connection
        volatile bool _isWelcome;
        double _silentS; // of the service; then the connection is given up
        long _id;
        uint _batch;

        Session(string name, Func<Service> find)
        {
            _name = name;
            _app = Service.WordOf(name);
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
        /// <returns>What ends that.</returns>
        public Action On<T>(Action<T> handler)
        {
            List<Action<object>> handlers;
            if (!_handlers.TryGetValue(typeof(T), out handlers)) _handlers[typeof(T)] = handlers = new List<Action<object>>();
            Action<object> calls = each => handler((T)each);
            handlers.Add(calls);
            return () => handlers.Remove(calls);
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

        /// <summary>Report a touch, now unless it says when; false where there is no connection.</summary>
        public bool Touch(float xMm, float yMm, float? normalForceN = null, int touchId = 0,
            TouchKind kind = TouchKind.Move, double? timeS = null)
        {
            return Touches(new[] { new TouchReport {
                TimeS = timeS ?? NowS, X = xMm, Y = yMm, NormalForceN = normalForceN, TouchId = touchId, Kind = kind } });
        }

        /// <summary>Take a finger off.</summary>
        public bool Lift(int touchId = 0) { return Touch(0f, 0f, null, touchId, TouchKind.Up); }

        /// <summary>
        /// Report many touches in one batch of bytes, at most `Welcome.Limits.BatchTouches`. Faster than the service
        /// takes them they wait, and what is asked meanwhile passes them; false where there is no connection, or
        /// while 1000 wait.
        /// </summary>
        public bool Touches(IList<TouchReport> touches)
        {
            lock (_gate)
                return _link != null && _isWelcome && _link.SendTouches(Batches.Write(touches, ++_batch), touches.Count,
                    touches.Any(each => each.Kind == TouchKind.Up));
        }

        /// <summary>Send a message and return its answer; throws `Refused` or `Lost`.</summary>
        public async Task<T> Ask<T>(string type, JObject fields)
        {
            TaskCompletionSource<JObject> answer = NewSource<JObject>();
            var message = new JObject { { "type", type }, { "id", 0 } };
            foreach (JProperty field in fields.Properties())
                if (field.Value.Type != JTokenType.Null) message[field.Name] = field.Value;
            long id;
            lock (_gate) // ids leave in their order
            {
                if (_link == null) throw new Lost(_closing.IsSet ? "this client is closed; connect again"
                    : type + ": the connection to the service is gone");
                message["id"] = id = ++_id;
                _asked[id] = answer;
                _link.Send(message);
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
            var found = (await answer.Task.ConfigureAwait(false)).ToObject<T>();
            Remember(type, fields);
            return found;
        }

        void Remember(string type, JObject fields)
        {
            lock (_gate)
            {
                if (type == "geometry") _geometry = fields;
                if (type == "layout_set") _felt = null;
                if (type == "watch") _watched.Add((string)fields["job"]);
                if (type != "subscribe") return;
                foreach (JProperty stream in ((JObject)fields["streams"]).Properties()) _streams[stream.Name] = stream.Value;
            }
        }

        /// <summary>Return the JSON of a material, a message or a number.</summary>
        internal static JToken Json(object value)
        {
            return value == null ? JValue.CreateNull() : JToken.FromObject(value, Given);
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
                await Ask<Done>("bye", new JObject()).ConfigureAwait(false);
            }
            catch (Exception) { } // it is gone already, and with it the voltage
        }
    }
}
