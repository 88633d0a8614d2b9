// The thread of a session: connects, answers pings, passes on what comes, connects again.
namespace Haptix
{
    using System;
    using System.Collections.Generic;
    using System.Threading.Tasks;
    using Haptix.Messages;
    using Newtonsoft.Json.Linq;

    public sealed partial class Session
    {
        void Run()
        {
            // Types are made ready by their first use; that must not delay the first answers to pings.
            JObject.Parse(Empty).ToObject<Welcome>();
            double waitS = FirstS;
            int refusals = 0;
            string reason = "closed";
            while (!_closing.IsSet)
            {
                try
                {
                    reason = Serve();
                    waitS = FirstS;
                    refusals = 0;
                }
                catch (Exception error)
                {
                    reason = error.Message;
                    var refused = error as Refused;
                    if (refused != null && (refused.Code != "access" || ++refusals == MostRefusals) || !_opened.Task.IsCompleted)
                    {
                        _opened.TrySetException(error);
                        break;
                    }
                }
                if (_closing.Wait(TimeSpan.FromSeconds(waitS))) break;
                waitS = Math.Min(2 * waitS, LastS);
            }
            Tell(new Closed { Reason = reason });
        }

        /// <summary>Connect, and take what comes until the connection is gone; return why it is.</summary>
        string Serve()
        {
            Service service = _find();
            using (Link link = Link.Open(service.Url))
            {
                _silentS = WaitS;
                lock (_gate) _link = link;
                var hello = new JObject { { "protocol", Protocol }, { "client", _name }, { "token", service.Token }, { "app", _app } };
                if (Welcome != null) hello["resume"] = Welcome.Resume;
                Task<Welcome> greeted = Ask<Welcome>("hello", hello);
                try
                {
                    while (link.IsOpen) Take(link);
                }
                finally
                {
                    _isWelcome = false;
                    LeaveAll();
                    lock (_gate)
                    {
                        _link = null;
                        foreach (TaskCompletionSource<JObject> each in _asked.Values)
                            each.TrySetException(new Lost("the connection is gone: " + link.Reason));
                        _asked.Clear();
                    }
                }
                greeted.GetAwaiter().GetResult(); // throws if it was refused
                if (!_closing.IsSet) Tell(new Disconnected { Reason = link.Reason });
                return link.Reason;
            }
        }

        void Greet(Welcome welcome)
        {
            bool again = Welcome != null;
            Output before = again && _felt != null && Lease.IsMine && Output.State != "off" ? Output : null;
            Welcome = welcome;
            Lease = welcome.Lease;
            Output = welcome.Output;
            _silentS = 3 * welcome.KeepAlive.IdleS;
            lock (_gate) if (_link != null) _link.Limit(welcome.Limits);
            Restore(again, before).ContinueWith(done => done.Exception, TaskContinuationOptions.OnlyOnFaulted);
        }

        /// <summary>The service keeps lease and layout for who resumes; these are of the session.</summary>
        async Task Restore(bool again, Output before)
        {
            JObject geometry, streams;
            lock (_gate)
            {
                geometry = _geometry;
                streams = new JObject { { "streams", _streams.DeepClone() } };
            }
            if (geometry != null) await Ask<Done>("geometry", geometry).ConfigureAwait(false);
            if (streams["streams"].HasValues) await Ask<Subscribed>("subscribe", streams).ConfigureAwait(false);
            string[] watched;
            lock (_gate) watched = new List<string>(_watched).ToArray();
            foreach (string job in watched)
            {
                try { Tell(await Watch(job).ConfigureAwait(false)); }
                catch (Refused) { lock (_gate) _watched.Remove(job); } // another service knows none
            }
            _isWelcome = true;
            if (before != null)
            {
                try { await FeelAgain(before).ConfigureAwait(false); }
                catch (Refused refused) { Tell(new Warning { Type = "warning", Sentence = "nothing is felt: " + refused.Message }); }
            }
            if (again) Tell(new Resumed { Welcome = Welcome });
            else _opened.TrySetResult(this);
        }

        void Take(Link link)
        {
            bool isText;
            byte[] data = link.Receive(TimeSpan.FromSeconds(_silentS), out isText);
            if (data == null) return;
            if (!isText)
            {
                Frame frame = Batches.Read(data);
                string[] names;
                if (_columns.TryGetValue(frame.Stream, out names)) frame.Names = names;
                Tell(frame);
                return;
            }
            JObject message = JObject.Parse(System.Text.Encoding.UTF8.GetString(data));
            string type = (string)message["type"];
            if (type == "ping")
            {
                link.Answer((long)message["n"]);
                return;
            }
            if (type == "welcome") Greet(message.ToObject<Welcome>());
            if (type == "lease") Lease = message.ToObject<Lease>();
            if (type == "output") Output = message.ToObject<Output>();
            if (type == "subscribed") _columns = message.ToObject<Subscribed>().Columns;
            long id = (long)message["id"];
            TaskCompletionSource<JObject> answer;
            lock (_gate)
            {
                if (_asked.TryGetValue(id, out answer)) _asked.Remove(id);
            }
            Type known;
            if (answer == null)
            {
                if (Types.TryGetValue(type, out known)) Tell(message.ToObject(known));
            }
            else if (type == "error") answer.TrySetException(new Refused(message.ToObject<Error>()));
            else answer.TrySetResult(message);
        }

        /// <summary>Tell that fingers are on no region any more: nothing comes over a lost connection.</summary>
        void LeaveAll()
        {
            foreach (Contact last in new List<Contact>(_on.Values))
                foreach (string each in last.Event == "press" ? new[] { "release", "leave" } : new[] { "leave" })
                    Tell(new Contact { Type = "contact", Event = each, Region = last.Region, TouchId = last.TouchId, TS = NowS });
        }

        void Note(Contact contact)
        {
            string place = contact.TouchId + " " + contact.Region;
            if (contact.Event == "leave") _on.Remove(place);
            else if (contact.Event != "detent") _on[place] = contact;
        }

        void Tell(object happened)
        {
            var contact = happened as Contact;
            if (contact != null) Note(contact);
            if (!(happened is Frame) || _events.Count < MostEvents) _events.Enqueue(happened);
        }

        static TaskCompletionSource<T> NewSource<T>()
        {
            // Who awaits must not run in the session's thread, which answers the pings.
            return new TaskCompletionSource<T>(TaskCreationOptions.RunContinuationsAsynchronously);
        }
    }
}
