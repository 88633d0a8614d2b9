// mono test.exe GOLDEN_FOLDER [golden]: all tests of the C# client, or the golden ones; mono test.exe FILE contract; against the service of HAPTIX_SERVICE.
using System;
using System.Collections.Generic;
using System.IO;
using System.Threading;
using System.Threading.Tasks;
using Haptix;
using Haptix.Messages;
using Newtonsoft.Json.Linq;

static class Check
{
    public static void That(bool holds, string what)
    {
        if (!holds) throw new Exception("expected: " + what);
    }

    /// <summary>Looks, 10 ms apart, after which a test hangs: a busy machine takes long.</summary>
    public const int Patience = 10000;

    public static async Task<Refused> Refuses(Func<Task> call)
    {
        try { await call(); }
        catch (Refused refused) { return refused; }
        throw new Exception("expected a refusal");
    }

    /// <summary>Pump until a message comes, as a scene does.</summary>
    public static T Next<T>(Session session, Action begin, Func<T, bool> wanted = null) where T : class
    {
        T found = null;
        session.On<T>(each => { if (found == null && (wanted == null || wanted(each))) found = each; });
        begin();
        for (int i = 0; i < Patience && found == null; i++)
        {
            session.Pump();
            Thread.Sleep(10);
        }
        That(found != null, "a " + typeof(T).Name);
        return found;
    }
}

static class Program
{
    static int Main(string[] arguments)
    {
        var tests = new List<Tuple<string, Func<Task>>>();
        Action<string, Func<Task>> add = (name, test) => tests.Add(Tuple.Create(name, test));
        string golden = arguments[0], which = arguments.Length > 1 ? arguments[1] : "all";
        if (which == "contract") add("contract", () => Contract.Play(golden));
        else add("bytes", () => Task.Run(() => Golden.Codec(golden)));
        foreach (string name in which == "contract" ? new string[0] : new[] { "hello", "touches", "refused" })
            add("session " + name, () => Task.Run(() => Golden.Play(Path.Combine(golden, name + ".jsonl"))));
        if (which == "all") // these need the engine that echoes
        {
            add("touches and contacts", Touches);
            add("a busy main thread", Busy);
            add("refusals", Refusals);
            add("layout", () => Regions(golden));
            add("takeover", Takeover);
            add("feel", Feel);
            add("telemetry", Telemetry);
            add("reconnecting", Reconnecting);
            add("old tokens", OldTokens);
            add("flood", () => Task.Run(() => Flood()));
        }
        int failed = 0;
        foreach (Tuple<string, Func<Task>> test in tests)
        {
            try
            {
                if (!test.Item2().Wait(TimeSpan.FromSeconds(200))) throw new Exception("it takes longer than 200 s");
                Console.WriteLine("passed " + test.Item1);
            }
            catch (Exception error)
            {
                failed++;
                Console.WriteLine("FAILED " + test.Item1 + ": " + error);
            }
        }
        return failed;
    }

    static async Task Touches()
    {
        using (Session h = await Session.Connect("test"))
        {
            await h.Geometry(4, new double[] { 10, 5 });
            await h.Acquire();
            Check.That(h.Lease.IsMine, "the lease");
            var ops = new object[] { new RemoveRegion { Op = "remove", Name = "ribs" } };
            Check.That((await h.LayoutChange(ops)).Revision == 1, "a layout");
            Check.That((await h.Arm()).State == "armed", "armed");
            double timeS = Session.NowS;
            Contact contact = Check.Next<Contact>(h, () => h.Touch(3f, 4f, 0.5f, 5, TouchKind.Down, timeS));
            Check.That(contact.TouchId == 5 && Math.Abs(contact.TS - timeS) < 10, "a contact of then");
            h.Touches(new[] { new TouchReport { TimeS = Session.NowS, InPixels = true, X = 40, Kind = TouchKind.Down } });
            h.Lift(5);
            await h.Stop();
            Check.That(h.Output.State == "off", "off");
        }
    }

    static async Task Regions(string golden)
    {
        string path = Path.Combine(Path.GetTempPath(), Path.GetRandomFileName() + ".json");
        using (Session h = await Session.Connect("test"))
        {
            File.WriteAllText(path, "{\"kind\": \"grating\", \"period_mm\": 2.0}");
            Region ribs = await h.Layout.Add(Material.Load(path), 1, 2, widthMm: 60, opacity: 0.5);
            File.Delete(path);
            Check.That(ribs.Name == "region 1", "a name");
            await ribs.Move(xMm: 5, overS: 0.1);
            await ribs.Change(opacity: 1);
            await ribs.SetValue(0.5);
            Check.That((await Check.Refuses(() => ribs.SetValue(2))).Path.EndsWith("/value"), "a path of the value");
            await ribs.Remove();
            await h.Layout.Clear();
            Refused refused = await Check.Refuses(() => ribs.Move(overS: -1));
            Check.That(refused.Code == "message" && refused.Path.EndsWith("/over_s"), "a path");
            string photograph = Path.Combine(golden, "bytes.jsonl"); // any file, under a name that is allowed
            string copy = Path.ChangeExtension(path, ".png");
            File.Copy(photograph, copy);
            string name = await h.Asset(copy);
            Check.That(name.Length == 71 && name.StartsWith("sha256:") && name == await h.Asset(copy), "an asset");
            File.Delete(copy);
            Check.That((await Check.Refuses(() => h.Asset(photograph))).Code == "document", "a suffix");
        }
    }

    // Nothing of the program runs for longer than the limit of silence, and nothing pumps.
    static async Task Busy()
    {
        using (Session h = await Session.Connect("test"))
        {
            await h.Acquire();
            await h.Arm();
            Thread.Sleep(700);
            // Where this machine stands still for that long, the next pong wakes it.
            for (int i = 0; i < Check.Patience && h.Output.State == "asleep"; i++) Thread.Sleep(10);
            Check.That(h.Output.State == "armed", "armed still, not " + h.Output.State);
        }
    }

    static async Task Refusals()
    {
        Session h = await Session.Connect("test");
        Check.That((await Check.Refuses(() => h.Arm())).Code == "lease", "lease");
        Refused refused = await Check.Refuses(() => h.Intensity(2));
        Check.That(refused.Code == "message" && refused.Path == "/value", "a path");
        Check.That((await Check.Refuses(() => h.Watch("none"))).Code == "unknown", "a job");
        string large = Path.GetTempFileName();
        using (FileStream file = File.OpenWrite(large)) file.SetLength(h.Welcome.Limits.AssetBytes + 1);
        refused = await Check.Refuses(() => h.Asset(large));
        File.Delete(large);
        Check.That(refused.Code == "limit" && refused.Message.Contains("send a smaller file"), "too large");
        Error error = Check.Next<Error>(h, () => h.Touch(1f, 1f));
        Check.That(error.Code == "lease", "an error of the touch");
        Check.Next<Closed>(h, () => h.Dispose());
        Check.That(!h.Touch(1f, 1f), "no connection");
        var behind = new Service("wss://far/hx/v1/session", "");
        Check.That(behind.Http("/v1/assets/1").ToString() == "https://far/hx/v1/assets/1", "behind a path");
        Service service = Service.Find();
        refused = await Check.Refuses(() => Session.Connect("test", () => new Service(service.Url, "guess")));
        Check.That(refused.Code == "access", "access");
        try { await Session.Connect("test", () => new Service("ws://127.0.0.1:1/", "")); }
        catch (Lost) { return; }
        throw new Exception("expected: lost");
    }

    static async Task Feel()
    {
        Region region = await Session.Feel("test", Material.Parse("{\"kind\": \"grating\", \"period_mm\": 2}"));
        using (Session h = region.Session)
        {
            Warning warning = Check.Next<Warning>(h, () => { });
            Check.That(warning.Sentence.Contains("call Arm") && h.Output.State == "off", "a real driver, and nobody has asked");
            Region again = await h.Feel(Material.Parse("{\"kind\": \"noise\"}"), personAsked: true);
            Check.That(h.Output.State == "armed" && again.Name == "felt", "armed");
            Task cut = h.Play(Material.Parse("{\"kind\": \"cut\"}")); // the engine of the tests closes the socket
            Check.Next<Resumed>(h, () => { });
            Check.That(cut.IsFaulted && h.Lease.IsMine && h.Output.State == "off", "a real driver is never armed again by itself");
            await again.Change(opacity: 0.5); // the service has kept the layout
        }
    }

    // A service that begins opens its port before it writes the new token.
    static async Task OldTokens()
    {
        Service service = Service.Find();
        int old = 0;
        Func<Service> find = () => new Service(service.Url, old-- > 0 ? "old" : service.Token);
        using (Session h = await Session.Connect("test", find))
        {
            await h.Acquire();
            old = 2;
            Check.Next<Resumed>(h, () => h.Play(Material.Parse("{\"kind\": \"cut\"}")));
            old = 100;
            Closed closed = Check.Next<Closed>(h, () => h.Play(Material.Parse("{\"kind\": \"cut\"}")));
            Check.That(closed.Reason.Contains("token") && old == 96, "given up after four");
        }
    }

    static async Task Takeover()
    {
        using (Session first = await Session.Connect("first"))
        {
            await first.Acquire();
            using (Session second = await Session.Connect("second"))
            {
                Refused refused = await Check.Refuses(() => second.Acquire());
                Check.That(refused.Path == "/takeover", "takeover");
                Check.Next<Lease>(first, () => second.Acquire(true).Wait(), lease => !lease.IsMine);
            }
            await first.Acquire(); // who leaves frees the lease
        }
    }

    static async Task Telemetry()
    {
        using (Session h = await Session.Connect("test"))
        {
            Frame frame = Check.Next<Frame>(h, () => h.Subscribe(new Dictionary<string, double> { { "stats", 10 } }).Wait());
            Check.That(frame.TouchId == 2 && frame.Rows[4] == 4f && float.IsNaN(frame.Rows[7]), "its rows");
            Check.That(frame.Names[3] == "touches", "its columns");
        }
    }

    // At one batch a second 1000 would take a quarter of an hour; what is asked passes them.
    static void Flood()
    {
        Service service = Service.Find();
        using (Link link = Link.Open(service.Url))
        {
            link.Send(new JObject { { "type", "hello" }, { "id", 1 }, { "protocol", "1.0" }, { "client", "flood" }, { "token", service.Token } });
            link.Limit(new Limits { TouchesPerS = 1, BatchesPerS = 1, BatchTouches = 1024 });
            int taken = 0;
            for (int i = 0; i < 2000; i++)
                if (link.SendTouches(Batches.Write(new[] { new TouchReport { TimeS = Session.NowS } }, 1), 1)) taken++;
            Check.That(taken >= 1064 && taken < 1500, "64 at once and 1000 that wait, not " + taken);
            link.Send(new JObject { { "type", "stop" }, { "id", 2 } });
            bool isText = true;
            for (JObject got = null; got == null || (int)got["id"] != 2;)
            {
                byte[] data = link.Receive(TimeSpan.FromSeconds(100), out isText);
                Check.That(data != null, "an answer");
                got = JObject.Parse(System.Text.Encoding.UTF8.GetString(data));
            }
        }
    }

    static async Task Reconnecting()
    {
        using (Session h = await Session.Connect("test"))
        {
            await h.Geometry(4);
            await h.Subscribe(new Dictionary<string, double> { { "stats", 10 } });
            string state = (await h.Watch("a1")).State;
            h.On<Job>(job => state += ", " + job.State);
            await h.Acquire();
            await h.Arm();
            Check.Next<Contact>(h, () => h.Touch(1, 1, 0.5f, 2, TouchKind.Down));
            string contacts = "";
            h.On<Contact>(each => contacts += each.Event + " " + each.TouchId + ",");
            Task slow = h.Play(Material.Parse("{\"kind\": \"cut\"}")); // the engine of the tests closes the socket
            Resumed resumed = Check.Next<Resumed>(h, () => { });
            Check.That(contacts == "leave 2,", "a leave for the enter, not " + contacts);
            Check.That(resumed.Welcome.Lease.IsMine && h.Output.State == "off", "the lease, disarmed");
            Check.That(state == "running, running", "the job is watched again: " + state);
            await h.Arm();
            Check.Next<Contact>(h, () => h.Touches(new[] {
                new TouchReport { TimeS = Session.NowS, InPixels = true, Kind = TouchKind.Down } }));
            try { await slow; }
            catch (Lost) { return; }
            throw new Exception("expected: lost");
        }
    }
}
