import pickle,collections,math
from qa import est,q
o=pickle.load(open('/tmp/qs.pkl','rb'))
B=collections.defaultdict(list)
for s in o:
    for r,t in zip(s['rows'],s['td']):
        for d,b in r[3]:
            if .8<t<1.8: B[int(t*10)].append((d,b,t))
for k in sorted(B):
    v=B[k];kn=[(d,t,b) for d,b,t in v if d>0]
    e=[d-t for d,t,b in kn];nr=[-d for d,b,t in v if d<0]
    print(k/10,'n',len(v),'hidden %.2f'%(1-len(kn)/len(v)),'e-t p10 %.2f p50 %.2f p90 %.2f'%(q(e,.1),q(e,.5),q(e,.9)),'| d p10 %.2f p50 %.2f p90 %.2f'%tuple(q([d for d,_,_ in kn],f) for f in (.1,.5,.9)), '| by |b| <6 %.2f 6-12 %.2f >12 %.2f'%tuple(q([d-t for d,t,b in kn if lo<=abs(b)<hi] or [0],.5) for lo,hi in ((0,6),(6,12),(12,30))))
